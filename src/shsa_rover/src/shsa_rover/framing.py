"""Frames in the bytes of a serial line, without any I/O: what all protocols here have in common."""
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Dict, Generic, List, Sequence, TypeVar

Content = TypeVar("Content")


@dataclass
class Counters:
    """Counts of a parser: good frames, and dropped bytes by reason; `noise` is in no frame."""

    frames: int
    dropped: Dict[str, int]

    @property
    def dropped_bytes(self) -> int:
        """All bytes that were part of no frame."""
        return sum(self.dropped.values())

    @property
    def reasons(self) -> str:
        """Return the dropped bytes by reason, in words."""
        return ", ".join(f"{number} {why}" for why, number in self.dropped.items() if number)


class Parser(ABC, Generic[Content]):
    """Takes bytes as they come and yields frames; after noise it finds the next frame by itself.

    A frame begins with `start`. `faults` are the reasons, beside noise, for which it is dropped.
    """

    def __init__(self, start: bytes, faults: Sequence[str]) -> None:
        self.counters = Counters(0, dict.fromkeys(("noise", *faults), 0))
        self._start = start
        self._buffer = bytearray()

    @abstractmethod
    def _fault(self) -> str:
        """Return why the bytes so far cannot be a frame; empty if they can."""

    @abstractmethod
    def _length(self) -> int:
        """Return the length of the frame at the buffer's start; 0: it is not complete."""

    @abstractmethod
    def _content(self, frame: bytes) -> Content:
        """Return what a whole frame without a fault says."""

    @property
    def pending_bytes(self) -> int:
        """Bytes kept because they may be the start of a frame."""
        return len(self._buffer)

    def reset(self) -> None:
        """Drops the unfinished frame, as after the line was cut."""
        self._drop(len(self._buffer), "noise")

    def feed(self, data: bytes) -> List[Content]:
        """Return the frames completed by `data`, oldest first."""
        self._buffer += data
        found: List[Content] = []
        while self._buffer:
            begin = self._begin()
            if begin:
                self._drop(begin, "noise")
                continue
            fault = self._fault()
            if fault:
                self._drop(1, fault)
                continue
            length = self._length()
            if not length:
                break
            found.append(self._content(bytes(self._buffer[:length])))
            del self._buffer[:length]
            self.counters.frames += 1
        return found

    def _begin(self) -> int:
        """Return the place where a frame begins, or may begin: its end may be that of the bytes."""
        place = self._buffer.find(self._start)
        if place >= 0:
            return place
        for length in range(len(self._start) - 1, 0, -1):
            if self._buffer.endswith(self._start[:length]):
                return len(self._buffer) - length
        return len(self._buffer)

    def _drop(self, number: int, reason: str) -> None:
        self.counters.dropped[reason] += number
        del self._buffer[:number]

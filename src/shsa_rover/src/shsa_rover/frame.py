"""The microcontroller's serial protocol, without any I/O: bytes in, frames out.

A frame is ``S``, the number of data bytes, high and low byte of each channel (10-bit ADC counts),
``E``, ``\\n\\r``. Data bytes may look like ``S`` or ``E``: only a whole frame whose every part is
valid counts.
"""
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence, Tuple

from shsa_core.errors import ShsaError

START = b"S"
TRAILER = b"E\n\r"
MAX_CHANNELS = 8
MAX_COUNT = 1023
MAX_FRAME_BYTES = 2 + 2 * MAX_CHANNELS + len(TRAILER)


class FrameError(ShsaError):
    """ADC counts cannot be put into a frame."""


@dataclass(frozen=True)
class Frame:
    """One sample of every channel, in ADC counts from 0 to 1023."""

    channels: Tuple[int, ...]


@dataclass
class Counters:
    """What a parser has seen: good frames, and dropped bytes by reason.

    Reasons: `noise` outside any frame, bad `length`, `value` above 10 bits, bad `trailer`.
    """

    frames: int = 0
    dropped: Dict[str, int] = field(
        default_factory=lambda: {"noise": 0, "length": 0, "value": 0, "trailer": 0}
    )

    @property
    def dropped_bytes(self) -> int:
        """All bytes that were part of no frame."""
        return sum(self.dropped.values())


def encode(channels: Sequence[int]) -> bytes:
    """The frame for ADC counts, one per channel; raises FrameError for what does not fit."""
    if not 1 <= len(channels) <= MAX_CHANNELS:
        raise FrameError(f"a frame has 1 to {MAX_CHANNELS} channels, not {len(channels)}")
    for number, count in enumerate(channels):
        if not 0 <= count <= MAX_COUNT:
            raise FrameError(f"channel {number}: {count} is not in 0 to {MAX_COUNT}")
    data = b"".join(count.to_bytes(2, "big") for count in channels)
    return START + bytes([len(data)]) + data + TRAILER


class Parser:
    """Takes bytes as they come and yields frames; after noise it finds the next frame by itself."""

    def __init__(self) -> None:
        self.counters = Counters()
        self._buffer = bytearray()

    @property
    def pending_bytes(self) -> int:
        """Bytes kept because they may be the start of a frame."""
        return len(self._buffer)

    def reset(self) -> None:
        """Drops the unfinished frame, as after the line was cut."""
        self._drop(len(self._buffer), "noise")

    def feed(self, data: bytes) -> List[Frame]:
        """The frames completed by `data`, oldest first."""
        self._buffer += data
        frames: List[Frame] = []
        while self._buffer:
            start = self._buffer.find(START)
            if start != 0:
                self._drop(len(self._buffer) if start < 0 else start, "noise")
                continue
            fault = self._fault()
            if fault:
                self._drop(1, fault)
                continue
            frame = self._take()
            if frame is None:
                break
            frames.append(frame)
        return frames

    def _drop(self, number: int, reason: str) -> None:
        self.counters.dropped[reason] += number
        del self._buffer[:number]

    def _fault(self) -> str:
        """Why what has come so far cannot be a frame; empty if it can."""
        buffer = self._buffer
        if len(buffer) < 2:
            return ""
        length = buffer[1]
        if length % 2 or not 2 <= length <= 2 * MAX_CHANNELS:
            return "length"
        if any(high > MAX_COUNT >> 8 for high in buffer[2 : 2 + length : 2]):
            return "value"
        trailer = bytes(buffer[2 + length : 2 + length + len(TRAILER)])
        return "" if TRAILER.startswith(trailer) else "trailer"

    def _take(self) -> Optional[Frame]:
        """The frame at the start of the faultless buffer, or None while it is not complete."""
        buffer = self._buffer
        if len(buffer) < 2 or len(buffer) < 2 + buffer[1] + len(TRAILER):
            return None
        end = 2 + buffer[1]
        channels = tuple(buffer[i] << 8 | buffer[i + 1] for i in range(2, end, 2))
        del buffer[: end + len(TRAILER)]
        self.counters.frames += 1
        return Frame(channels)

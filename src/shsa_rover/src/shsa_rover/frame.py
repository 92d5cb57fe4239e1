"""The microcontroller's serial protocol, without any I/O: bytes in, frames out.

A frame is ``S``, the number of data bytes, high and low byte of each channel (10-bit ADC counts),
``E``, ``\\n\\r``. Data bytes may look like ``S`` or ``E``: only a whole frame whose every part is
valid counts.

That is the paper's. A checked frame begins with ``C`` instead, and has the CRC-16/CCITT of the
number and the data, high byte first, before its ``E``: no one, two or three flipped bits in what it
covers, and no burst of up to 16, pass it. A parser takes one sort or the other: which it is, the
line cannot say.
"""
import binascii
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence, Tuple

from shsa_core.errors import ShsaError

START, CHECKED_START = b"S", b"C"
TRAILER = b"E\n\r"
MAX_CHANNELS = 8
MAX_COUNT = 1023
CHECKSUM_BYTES = 2
MAX_FRAME_BYTES = 2 + 2 * MAX_CHANNELS + CHECKSUM_BYTES + len(TRAILER)


class FrameError(ShsaError):
    """ADC counts cannot be put into a frame."""


@dataclass(frozen=True)
class Frame:
    """One sample of every channel, in ADC counts from 0 to 1023."""

    channels: Tuple[int, ...]


@dataclass
class Counters:
    """Counts of a parser: good frames, and dropped bytes by reason.

    Reasons: `noise` outside any frame, bad `length`, `value` above 10 bits, `checksum`, bad
    `trailer`.
    """

    frames: int = 0
    dropped: Dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(
            ("noise", "length", "value", "checksum", "trailer"), 0
        )
    )

    @property
    def dropped_bytes(self) -> int:
        """All bytes that were part of no frame."""
        return sum(self.dropped.values())


def encode(channels: Sequence[int], checked: bool = False) -> bytes:
    """Return the frame for ADC counts, one per channel; raises FrameError for what does not fit.

    `checked`: one with a checksum.
    """
    if not 1 <= len(channels) <= MAX_CHANNELS:
        raise FrameError(f"a frame has 1 to {MAX_CHANNELS} channels, not {len(channels)}")
    for number, count in enumerate(channels):
        if not 0 <= count <= MAX_COUNT:
            raise FrameError(f"channel {number}: {count} is not in 0 to {MAX_COUNT}")
    data = b"".join(count.to_bytes(2, "big") for count in channels)
    body = bytes([len(data)]) + data
    return (CHECKED_START if checked else START) + body + _end(body, checked)


def _end(body: bytes, checked: bool) -> bytes:
    """Return the bytes that follow the number of data bytes and the data."""
    if not checked:
        return TRAILER
    return binascii.crc_hqx(body, 0xFFFF).to_bytes(CHECKSUM_BYTES, "big") + TRAILER


class Parser:
    """Takes bytes as they come and yields frames; after noise it finds the next frame by itself.

    `checked`: the frames have a checksum.
    """

    def __init__(self, checked: bool = False) -> None:
        self.counters = Counters()
        self._checked = checked
        self._start = CHECKED_START if checked else START
        self._end_bytes = len(TRAILER) + (CHECKSUM_BYTES if checked else 0)
        self._buffer = bytearray()

    @property
    def pending_bytes(self) -> int:
        """Bytes kept because they may be the start of a frame."""
        return len(self._buffer)

    def reset(self) -> None:
        """Drops the unfinished frame, as after the line was cut."""
        self._drop(len(self._buffer), "noise")

    def feed(self, data: bytes) -> List[Frame]:
        """Return the frames completed by `data`, oldest first."""
        self._buffer += data
        frames: List[Frame] = []
        while self._buffer:
            start = self._buffer.find(self._start)
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
        """Return why the bytes so far cannot be a frame; empty if they can."""
        buffer = self._buffer
        if len(buffer) < 2:
            return ""
        length = buffer[1]
        if length % 2 or not 2 <= length <= 2 * MAX_CHANNELS:
            return "length"
        if any(high > MAX_COUNT >> 8 for high in buffer[2 : 2 + length : 2]):
            return "value"
        end = bytes(buffer[2 + length : 2 + length + self._end_bytes])
        expected = _end(bytes(buffer[1 : 2 + length]), self._checked)
        if expected.startswith(end):
            return ""
        checksum = self._end_bytes - len(TRAILER)
        return "trailer" if end[:checksum] == expected[:checksum] else "checksum"

    def _take(self) -> Optional[Frame]:
        """Return the frame at the buffer's start, or None while it is not complete."""
        buffer = self._buffer
        if len(buffer) < 2 or len(buffer) < 2 + buffer[1] + self._end_bytes:
            return None
        end = 2 + buffer[1]
        channels = tuple(buffer[i] << 8 | buffer[i + 1] for i in range(2, end, 2))
        del buffer[: end + self._end_bytes]
        self.counters.frames += 1
        return Frame(channels)

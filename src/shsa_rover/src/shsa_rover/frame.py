"""The microcontroller's serial protocol, without any I/O: bytes in, frames out.

A frame is ``S``, the number of data bytes, high and low byte of each channel (10-bit ADC counts),
``E``, ``\\n\\r``. Data bytes may look like ``S`` or ``E``: only a whole frame whose every part is
valid counts. Channel 0 is the battery's current, channel 1 its voltage.

That is the paper's. A checked frame begins with ``C`` instead, and has the CRC-16/CCITT of the
number and the data, high byte first, before its ``E``: no one, two or three flipped bits in what it
covers, and no burst of up to 16, pass it. A parser takes one sort or the other: which it is, the
line cannot say.
"""
import binascii
from dataclasses import dataclass
from typing import Sequence, Tuple

from shsa_core.errors import ShsaError
from shsa_rover import framing

START, CHECKED_START = b"S", b"C"
TRAILER = b"E\n\r"
CURRENT, VOLTAGE = 0, 1
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


class Parser(framing.Parser[Frame]):
    """Finds frames. `checked`: they have a checksum."""

    def __init__(self, checked: bool = False) -> None:
        super().__init__(
            CHECKED_START if checked else START, ("length", "value", "checksum", "trailer")
        )
        self._checked = checked
        self._end_bytes = len(TRAILER) + (CHECKSUM_BYTES if checked else 0)

    def _fault(self) -> str:
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

    def _length(self) -> int:
        buffer = self._buffer
        length = 2 + buffer[1] + self._end_bytes if len(buffer) > 1 else MAX_FRAME_BYTES
        return length if length <= len(buffer) else 0

    def _content(self, frame: bytes) -> Frame:
        data = frame[2 : 2 + frame[1]]
        return Frame(tuple(data[i] << 8 | data[i + 1] for i in range(0, len(data), 2)))

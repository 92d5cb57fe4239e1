r"""The IMU's serial protocol, without any I/O: sentences as NMEA 0183 has them.

A sentence is ``$PIMU,<rad/s>,<m/s^2>*<checksum>\r\n``: the turn rate about the vertical axis and
what the accelerometer along the rover feels, with six decimals. In NMEA's stead of 8 bits, the
checksum is the CRC-16/CCITT of what is between ``$`` and ``*``, as four hexadecimal digits.
"""
import binascii
import math
import re
from dataclasses import dataclass

from shsa_core.errors import ShsaError
from shsa_rover import framing

START, END = b"$", b"\n"
MAX_BYTES = 48
_SENTENCE = re.compile(
    rb"\$(PIMU,(-?\d{1,4}\.\d{6}),(-?\d{1,4}\.\d{6}))\*([0-9A-F]{4})\r\n", re.ASCII
)
LARGEST = 9999.0


class SentenceError(ShsaError):
    """A reading cannot be put into a sentence."""


@dataclass(frozen=True)
class ImuReading:
    """rad/s and m/s^2."""

    turn_rate: float
    specific_force: float


def encode(reading: ImuReading) -> bytes:
    """Return the sentence of a reading; raises SentenceError for what does not fit."""
    values = (reading.turn_rate, reading.specific_force)
    if not all(math.isfinite(value) and abs(value) <= LARGEST for value in values):
        raise SentenceError(f"{values} are not numbers of up to {LARGEST:g}")
    body = ("PIMU," + ",".join(f"{value:.6f}" for value in values)).encode()
    return START + body + _checksum(body) + b"\r" + END


def _checksum(body: bytes) -> bytes:
    return b"*%04X" % binascii.crc_hqx(body, 0xFFFF)


class Parser(framing.Parser[ImuReading]):
    """Finds sentences."""

    def __init__(self) -> None:
        super().__init__(START, ("length", "form", "checksum"))

    def _fault(self) -> str:
        length = self._length()
        if not length:
            return "length" if len(self._buffer) >= MAX_BYTES else ""
        found = _SENTENCE.fullmatch(bytes(self._buffer[:length]))
        if found is None:
            return "form"
        return "" if _checksum(found.group(1)) == b"*" + found.group(4) else "checksum"

    def _length(self) -> int:
        return self._buffer.find(END, 0, MAX_BYTES) + 1

    def _content(self, frame: bytes) -> ImuReading:
        found = _SENTENCE.fullmatch(frame)
        assert found is not None
        return ImuReading(float(found.group(2)), float(found.group(3)))

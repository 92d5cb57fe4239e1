"""Faults of a serial line: each makes faulty bytes of what was received."""
from random import Random
from typing import Dict, Optional, Type


class LineFault:
    """A fault of a line. `detail`: what was drawn for it, in words."""

    detail = ""

    def __init__(self, random: Random) -> None:
        self._random = random

    def feed(self, data: bytes) -> Optional[bytes]:
        """Return what is received instead; None: the port is gone."""
        raise NotImplementedError


class Noise(LineFault):
    """Bits flip, and bytes are lost."""

    def __init__(self, random: Random) -> None:
        super().__init__(random)
        self._flips = random.uniform(0.02, 0.2)
        self._losses = random.uniform(0.01, 0.1)
        self.detail = f"a bit of {self._flips:.0%} of the bytes flips, {self._losses:.0%} are lost"

    def feed(self, data: bytes) -> Optional[bytes]:
        received = bytearray()
        for byte in data:
            if self._random.random() < self._losses:
                continue
            if self._random.random() < self._flips:
                byte ^= 1 << self._random.randrange(8)
            received.append(byte)
        return bytes(received)


class Silence(LineFault):
    """Nothing comes."""

    def feed(self, data: bytes) -> Optional[bytes]:
        return b""


class Unplugged(LineFault):
    """The port is gone."""

    def feed(self, data: bytes) -> Optional[bytes]:
        return None


LINE_FAULTS: Dict[str, Type[LineFault]] = {
    "serial_noise": Noise,
    "serial_silence": Silence,
    "serial_unplug": Unplugged,
}
"""The class of each fault of a serial line."""


def line_fault(word: str, seed: int) -> LineFault:
    """Return the fault of a word; the same seed, the same fault."""
    return LINE_FAULTS[word](Random(f"{word} {seed}"))

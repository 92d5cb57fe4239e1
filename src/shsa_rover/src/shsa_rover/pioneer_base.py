"""The robot's end of the Pioneer's protocol, without any I/O: commands in, replies out."""
import math
from contextlib import suppress

from shsa_rover.p2os import (
    CLOSE,
    ENABLE,
    OPEN,
    RVEL,
    STOP,
    SYNC,
    VEL,
    Command,
    PacketError,
    Packets,
    ServerInfo,
    decode_command,
    encode_sip,
    packet,
)

NAME = b"Rover\0Pioneer\0p3at-sh\0"  # name, class and subclass: the reply to the last SYNC


class PioneerBase:
    """A base that echoes SYNC0 to SYNC2, then sends SIPs once it is opened, and obeys.

    `velocity` (m/s) and `turn_rate` (rad/s) are what it was told, and 0 while its motors are off.
    `heard` counts the client's packets while it is open: each of them resets its watchdog.
    """

    def __init__(self) -> None:
        self._packets = Packets()
        self._synchronised = 0  # steps done
        self.open = self.enabled = False
        self.heard = 0
        self._velocity = self._turn_rate = 0.0

    @property
    def velocity(self) -> float:
        """m/s."""
        return self._velocity if self.enabled else 0.0

    @property
    def turn_rate(self) -> float:
        """rad/s."""
        return self._turn_rate if self.enabled else 0.0

    def feed(self, data: bytes) -> bytes:
        """Return the replies to what the client sent."""
        return b"".join(self._answer(each) for each in self._packets.feed(data))

    def report(self, left: float, right: float, battery: float) -> bytes:
        """Return the SIP of the wheels' speeds (m/s) and the battery (V); none while closed."""
        if not self.open:
            return b""
        left_mm_s, right_mm_s = round(1000.0 * left), round(1000.0 * right)
        return encode_sip(ServerInfo(0, 0, 0.0, left_mm_s, right_mm_s, battery, self.enabled))

    def _answer(self, data: bytes) -> bytes:
        if self._synchronised < len(SYNC):
            return self._synchronise(data)
        with suppress(PacketError):  # ARCOS says nothing, either
            self._obey(decode_command(data))
        return b""

    def _synchronise(self, data: bytes) -> bytes:
        if data == bytes([SYNC[0]]):
            self._synchronised = 0
        if data != bytes([SYNC[self._synchronised]]):
            return b""
        self._synchronised += 1
        return packet(data + NAME if self._synchronised == len(SYNC) else data)

    def _obey(self, command: Command) -> None:
        number, argument = command.number, command.argument or 0
        if number == OPEN:
            self.open = True
        elif number == CLOSE:
            self.open = self.enabled = False
            self._synchronised = 0
        if not self.open:
            return
        self.heard += 1
        if number == ENABLE:
            self.enabled = bool(argument)
        elif number == VEL:
            self._velocity = argument / 1000.0
        elif number == RVEL:
            self._turn_rate = math.radians(argument)
        elif number == STOP:
            self._velocity = self._turn_rate = 0.0

"""The Pioneer's serial protocol (P2OS, ARCOS), without any I/O: packets in both directions.

A packet is 0xFA 0xFB, the number of bytes that follow, data, and the data's checksum, high byte
first. The client sends commands: a number, and for most of them the sort and the size of an
integer. The base sends server information packets (SIPs). Numbers of two bytes have their low byte
first. The protocol is that of the robot's manual (Pioneer 3 Operations Manual, chapter ARCOS).

Any one flipped bit is found by the checksum, which is a sum: two can cancel each other out.
"""
import math
from dataclasses import dataclass
from struct import Struct
from typing import Optional, Tuple

from shsa_core.errors import ShsaError
from shsa_rover import framing

HEADER = b"\xfa\xfb"
CHECKSUM_BYTES = 2
MAX_DATA_BYTES = 200
MAX_PACKET_BYTES = len(HEADER) + 1 + MAX_DATA_BYTES + CHECKSUM_BYTES
SYNC = (0, 1, 2)  # the base echoes them, one after the other; then it knows commands
PULSE, OPEN, CLOSE, ENABLE, VEL, RVEL, STOP = 0, 1, 2, 4, 11, 21, 29
POSITIVE, NEGATIVE, TEXT = 0x3B, 0x1B, 0x2B
STOPPED, MOVING = 0x32, 0x33
MOTORS_ENABLED = 1
FULL_TURN = 4096  # of a heading
FASTEST_MM_S = 3000  # no robot of this family has half of it
_SIP = Struct("<BHHhhhBBBhHBB")  # up to the number of sonar readings
_SONAR_BYTES, _SIP_END_BYTES = 3, 5


class PacketError(ShsaError):
    """Data cannot be put into a packet, or a packet's data are not what it claims to be."""


@dataclass(frozen=True)
class Command:
    """A command of the client, and its argument if it has an integer."""

    number: int
    argument: Optional[int] = None


@dataclass(frozen=True)
class ServerInfo:
    """A standard SIP, as far as it is used here.

    Position in mm and speeds of the wheels in mm/s, heading in rad, the battery in V.
    """

    x: int
    y: int
    heading: float
    left: int
    right: int
    battery: float
    motors_enabled: bool


def checksum(data: bytes) -> int:
    """Return the sum of the data's words; a last single byte is put in by exclusive or."""
    words = sum(data[i] << 8 | data[i + 1] for i in range(0, len(data) - 1, 2)) & 0xFFFF
    return words ^ data[-1] if len(data) % 2 else words


def packet(data: bytes) -> bytes:
    """Return the packet of `data`; raises PacketError for what does not fit."""
    if not 1 <= len(data) <= MAX_DATA_BYTES:
        raise PacketError(f"a packet has 1 to {MAX_DATA_BYTES} bytes of data, not {len(data)}")
    end = checksum(data).to_bytes(CHECKSUM_BYTES, "big")
    return HEADER + bytes([len(data) + CHECKSUM_BYTES]) + data + end


class Packets(framing.Parser[bytes]):
    """Finds packets, and yields their data."""

    def __init__(self) -> None:
        super().__init__(HEADER, ("length", "checksum"))

    def _fault(self) -> str:
        buffer = self._buffer
        if len(buffer) > 2 and not 1 <= buffer[2] - CHECKSUM_BYTES <= MAX_DATA_BYTES:
            return "length"
        length = self._length()
        if not length or packet(self._content(bytes(buffer[:length]))) == buffer[:length]:
            return ""
        return "checksum"

    def _length(self) -> int:
        buffer = self._buffer
        length = 3 + buffer[2] if len(buffer) > 2 else MAX_PACKET_BYTES
        return length if length <= len(buffer) else 0

    def _content(self, frame: bytes) -> bytes:
        return frame[3:-CHECKSUM_BYTES]


def encode_command(command: Command) -> bytes:
    """Return the packet of a command; raises PacketError for an argument beyond 15 bits."""
    data = bytes([command.number])
    if command.argument is not None:
        size = abs(command.argument)
        if size > 0x7FFF:
            raise PacketError(f"command {command.number}: {command.argument} is beyond 15 bits")
        data += bytes([POSITIVE if command.argument >= 0 else NEGATIVE])
        data += size.to_bytes(2, "little")
    return packet(data)


def decode_command(data: bytes) -> Command:
    """Return the command in a packet's data; raises PacketError if there is none."""
    if len(data) == 1 or (len(data) > 1 and data[1] == TEXT):
        return Command(data[0])
    if len(data) != 4 or data[1] not in (POSITIVE, NEGATIVE):
        raise PacketError(f"no command: {data.hex()}")
    size = int.from_bytes(data[2:], "little")
    return Command(data[0], size if data[1] == POSITIVE else -size)


def encode_motion(velocity: float, turn_rate: float) -> bytes:
    """Return VEL and RVEL for a velocity (m/s) and a turn rate (rad/s): whole mm/s and deg/s."""
    most = 0x7FFF
    forward = min(most, max(-most, round(1000.0 * velocity)))
    turn = min(most, max(-most, round(math.degrees(turn_rate))))
    return encode_command(Command(VEL, forward)) + encode_command(Command(RVEL, turn))


def encode_sip(info: ServerInfo) -> bytes:
    """Return the packet of a SIP without sonar readings."""
    heading = round(info.heading / math.tau * FULL_TURN)
    heading = (heading + FULL_TURN // 2) % FULL_TURN - FULL_TURN // 2
    body = _SIP.pack(
        MOVING if info.left or info.right else STOPPED,
        info.x & 0xFFFF,
        info.y & 0xFFFF,
        heading,
        info.left,
        info.right,
        min(255, max(0, round(10.0 * info.battery))),
        0,
        0,
        heading,
        MOTORS_ENABLED * info.motors_enabled,
        0,
        0,
    )
    return packet(body + bytes(_SIP_END_BYTES))


def decode_sip(data: bytes) -> ServerInfo:
    """Return the standard SIP in a packet's data; raises PacketError if there is none.

    Newer firmware adds fields at its end, which are left out.
    """
    if len(data) < _SIP.size or data[0] not in (STOPPED, MOVING):
        raise PacketError(f"no standard SIP: {data.hex()}")
    fields: Tuple[int, ...] = _SIP.unpack_from(data)
    _, x, y, heading, left, right, battery, _, _, _, flags, _, sonars = fields
    if len(data) < _SIP.size + _SONAR_BYTES * sonars + _SIP_END_BYTES:
        raise PacketError(f"a SIP that is too short for its {sonars} sonar readings: {data.hex()}")
    if max(abs(left), abs(right)) > FASTEST_MM_S:
        raise PacketError(f"a SIP of wheels at {left} and {right} mm/s")
    return ServerInfo(
        x=x,
        y=y,
        heading=heading * math.tau / FULL_TURN,
        left=left,
        right=right,
        battery=0.1 * battery,
        motors_enabled=bool(flags & MOTORS_ENABLED),
    )

"""The protocols of base and IMU: no good frame is lost, no bad one passes, every byte counts."""
import math
from typing import Any, Callable, Iterator, List, NamedTuple

import pytest
from hypothesis import given, strategies as st

from shsa_rover import framing, imu_sentence, p2os
from shsa_rover.imu_sentence import ImuReading, SentenceError
from shsa_rover.p2os import Command, PacketError, ServerInfo
from shsa_rover.pioneer_base import PioneerBase

INFO = ServerInfo(0x1234, 4, math.pi / 2, 251, -250, 12.3, True)
READING = ImuReading(-0.250017, 9.81)


class Line(NamedTuple):
    """A protocol: its parser, how a content is sent, two contents, and its longest frame."""

    parser: Callable[[], "framing.Parser[Any]"]
    encode: Callable[[Any], bytes]
    contents: List[Any]
    longest: int


SIP = p2os.encode_sip(INFO)[3:-2]
LINES = {
    "base": Line(p2os.Packets, p2os.packet, [SIP, b"\xfa\xfb\x03"], p2os.MAX_PACKET_BYTES),
    "imu": Line(
        imu_sentence.Parser,
        imu_sentence.encode,
        [READING, ImuReading(0.0, -0.5)],
        imu_sentence.MAX_BYTES,
    ),
}
lines = pytest.mark.parametrize("line", LINES.values(), ids=list(LINES))
# Noise made of the very bytes that frames are made of is the hardest to tell from frames.
noise = st.one_of(
    st.binary(max_size=40),
    st.lists(st.sampled_from(list(b"\xfa\xfb\x03\x06$PIMU,.0*\r\n")), max_size=60).map(bytes),
)


def flipped(data: bytes) -> Iterator[bytes]:
    """Yield the bytes with each one of their bits flipped."""
    for bit in range(8 * len(data)):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        yield bytes(changed)


@lines
@given(pieces=st.lists(st.one_of(noise, st.integers(0, 1))), cuts=st.lists(st.integers(0, 400)))
def test_every_byte_is_accounted_for_however_it_comes(
    line: Line, pieces: List[Any], cuts: List[int]
) -> None:
    sent = [p if isinstance(p, bytes) else line.encode(line.contents[p]) for p in pieces]
    data = b"".join(sent)
    whole, split = line.parser(), line.parser()
    found = whole.feed(data)
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    assert found == [
        frame for begin, end in zip(places, places[1:]) for frame in split.feed(data[begin:end])
    ]
    assert split.counters == whole.counters
    used = sum(len(line.encode(each)) for each in found)
    assert used + whole.counters.dropped_bytes + whole.pending_bytes == len(data)
    assert whole.pending_bytes < line.longest and whole.counters.frames == len(found)


@lines
@given(disturbance=noise)
def test_finds_the_next_frames_after_noise(line: Line, disturbance: bytes) -> None:
    good = line.encode(line.contents[0])
    lost = -(-line.longest // len(good))  # noise may begin what looks like a longest frame
    found = line.parser().feed(disturbance + good * (lost + 3))
    assert found[-3:] == line.contents[:1] * 3


@lines
def test_no_flipped_bit_passes_for_a_value(line: Line) -> None:
    good = line.encode(line.contents[0])
    for bad in flipped(good):
        found = line.parser().feed(good + bad + good * 10)
        assert set(found) == {line.contents[0]} and len(found) >= 2


@lines
@given(cut=st.integers(1, 30))
def test_a_cut_line_spoils_the_frame_that_it_cut_alone(line: Line, cut: int) -> None:
    first, second = map(line.encode, line.contents)
    parser = line.parser()
    parser.feed(first[: min(cut, len(first) - 1)])
    parser.reset()
    assert parser.feed(second) == line.contents[1:]


def test_packets_as_the_manual_has_them() -> None:
    assert p2os.encode_command(Command(p2os.SYNC[0])) == bytes([250, 251, 3, 0, 0, 0])
    assert p2os.encode_command(Command(p2os.SYNC[1])) == bytes([250, 251, 3, 1, 0, 1])
    assert p2os.encode_command(Command(p2os.OPEN)) == bytes([250, 251, 3, 1, 0, 1])
    enable = bytes([250, 251, 6, 4, 59, 1, 0, 5, 59])
    assert p2os.encode_command(Command(p2os.ENABLE, 1)) == enable
    assert p2os.encode_motion(-0.3, 0.0)[:7] == bytes([250, 251, 6, 11, 0x1B, 0x2C, 0x01])


@given(st.integers(0, 255), st.one_of(st.none(), st.integers(-0x7FFF, 0x7FFF)))
def test_a_command_comes_out_as_it_went_in(number: int, argument: int) -> None:
    (data,) = p2os.Packets().feed(p2os.encode_command(Command(number, argument)))
    assert p2os.decode_command(data) == Command(number, argument)


@given(st.integers(-700, 700), st.integers(-700, 700), st.integers(0, 255), st.booleans())
def test_a_report_comes_out_as_it_went_in(left: int, right: int, tenths: int, on: bool) -> None:
    info = ServerInfo(65535, 0, -math.pi, left, right, 0.1 * tenths, on)
    (data,) = p2os.Packets().feed(p2os.encode_sip(info))
    assert p2os.decode_sip(data) == info


def test_a_report_with_sonar_readings_and_newer_fields_is_understood() -> None:
    readings = bytes([2, 0, 10, 0, 1, 20, 0])
    assert p2os.decode_sip(SIP[:19] + readings + SIP[20:] + b"\x7b\x00\x01") == INFO


@pytest.mark.parametrize(
    "data, message",
    [
        (b"\x20" + SIP[1:], "no standard SIP: 20"),
        (SIP[:-6], "no standard SIP"),
        (SIP[:19] + b"\x07" + SIP[20:], "too short for its 7 sonar readings"),
        (SIP[:7] + b"\xff\x7f" + SIP[9:], "wheels at 32767 and -250 mm/s"),
    ],
)
def test_what_is_no_report_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(PacketError, match=message):
        p2os.decode_sip(data)


@given(st.binary(min_size=1, max_size=60))
def test_data_are_read_or_refused(data: bytes) -> None:
    for decode in (p2os.decode_sip, p2os.decode_command):
        try:
            decode(data)
        except PacketError:
            pass


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(PacketError, match="command 11: -40000 is beyond 15 bits"):
        p2os.encode_command(Command(p2os.VEL, -40000))
    with pytest.raises(PacketError, match="not 201"):
        p2os.packet(bytes(201))
    with pytest.raises(SentenceError, match="are not numbers of up to"):
        imu_sentence.encode(ImuReading(math.nan, 0.0))
    assert p2os.encode_motion(1e9, -1e9) == p2os.encode_motion(32.767, -math.radians(32767.0))


def test_a_sentence_as_the_imu_sends_it() -> None:
    assert imu_sentence.encode(READING) == b"$PIMU,-0.250017,9.810000*3305\r\n"


def opened() -> PioneerBase:
    """Return a base that is open, with its motors on."""
    base = PioneerBase()
    for number in p2os.SYNC:
        base.feed(p2os.encode_command(Command(number)))
    base.feed(p2os.encode_command(Command(p2os.OPEN)))
    base.feed(p2os.encode_command(Command(p2os.ENABLE, 1)))
    return base


def test_a_base_is_opened_step_by_step() -> None:
    base = PioneerBase()
    assert base.feed(p2os.encode_motion(0.5, 0.0)) == base.report(0.0, 0.0, 12.0) == b""
    for number in p2os.SYNC:
        (reply,) = p2os.Packets().feed(base.feed(p2os.encode_command(Command(number))))
        assert reply[0] == number
    assert reply[1:].split(b"\0")[1:3] == [b"Pioneer", b"p3at-sh"]
    assert not base.open
    base.feed(p2os.encode_command(Command(p2os.OPEN)))
    (report,) = p2os.Packets().feed(base.report(0.25, 0.3, 12.34))
    info = p2os.decode_sip(report)
    assert (info.left, info.right, info.battery) == (250, 300, pytest.approx(12.3))
    assert not info.motors_enabled


def test_a_base_obeys_while_its_motors_are_on() -> None:
    base = opened()
    base.feed(p2os.encode_motion(0.5, -0.7))
    assert (base.velocity, base.turn_rate) == (0.5, pytest.approx(-math.radians(40)))
    base.feed(p2os.encode_command(Command(p2os.ENABLE, 0)))
    assert (base.velocity, base.turn_rate) == (0.0, 0.0)
    base.feed(p2os.encode_command(Command(p2os.ENABLE, 1)) + p2os.encode_motion(0.2, 0.0))
    base.feed(p2os.encode_command(Command(p2os.STOP)))
    assert (base.velocity, base.turn_rate) == (0.0, 0.0)


def test_a_pulse_is_heard_and_says_nothing_and_a_client_may_come_back() -> None:
    base = opened()
    base.feed(p2os.encode_motion(0.5, 0.0))
    before = base.heard
    assert base.feed(p2os.encode_command(Command(p2os.SYNC[0]))) == b""  # it is a pulse by now
    assert base.heard == before + 1 and base.velocity == 0.5
    base.feed(p2os.encode_command(Command(p2os.CLOSE)))
    assert not base.open and base.velocity == 0.0
    assert base.feed(p2os.encode_command(Command(p2os.SYNC[0])))


@given(st.lists(st.one_of(noise, st.sampled_from([bytes([11, 59, 1, 0]), b"\x0b\x3b"]))))
def test_a_base_survives_anything(pieces: List[bytes]) -> None:
    base = opened()
    for piece in pieces:
        base.feed(piece)
        if piece:
            base.feed(p2os.packet(piece))
    assert math.isfinite(base.velocity) and math.isfinite(base.turn_rate)

"""The serial framing: nothing good is lost, nothing bad gets through, every byte counts."""
import random
from itertools import combinations
from typing import Iterator, List, Tuple

import pytest
from hypothesis import given, strategies as st

from shsa_rover.frame import MAX_CHANNELS, MAX_FRAME_BYTES, Frame, FrameError, Parser, encode

counts = st.lists(st.integers(0, 1023), min_size=1, max_size=MAX_CHANNELS)
# Noise made of the very bytes that frames are made of is the hardest to tell from frames.
noise = st.one_of(
    st.binary(max_size=40),
    st.lists(st.sampled_from(list(b"S\x02\x00\x03E\n\r")), max_size=40).map(bytes),
)


def feed_in_pieces(parser: Parser, data: bytes, cuts: List[int]) -> List[Frame]:
    """Feeds `data` cut at the places `cuts`."""
    frames: List[Frame] = []
    places = [0] + sorted(cut % (len(data) + 1) for cut in cuts) + [len(data)]
    for begin, end in zip(places, places[1:]):
        frames += parser.feed(data[begin:end])
    return frames


def test_a_frame_as_the_microcontroller_sends_it() -> None:
    assert encode([0x0123]) == b"S\x02\x01\x23E\n\r"
    assert encode([1023, 0]) == b"S\x04\x03\xff\x00\x00E\n\r"
    assert Parser().feed(b"S\x04\x03\xff\x00\x00E\n\r") == [Frame((1023, 0))]


@pytest.mark.parametrize(
    "channels, message",
    [
        ([], "1 to 8 channels, not 0"),
        ([0] * 9, "1 to 8 channels, not 9"),
        ([1, 1024], "channel 1: 1024 is not in 0 to 1023"),
        ([-1], "channel 0: -1 is not in 0 to 1023"),
    ],
)
def test_counts_that_do_not_fit_are_refused(channels: List[int], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        encode(channels)


@pytest.mark.parametrize("low", list(b"SE\n\r\x02"))
def test_data_that_looks_like_framing(low: int) -> None:
    for high in range(4):
        channels = (high << 8 | low, 0x0053, 0x0045)
        parser = Parser()
        assert parser.feed(encode(channels) * 3) == [Frame(channels)] * 3
        assert parser.counters.dropped_bytes == 0


@pytest.mark.parametrize("low", list(b"SE\n\r\x02"))
@pytest.mark.parametrize("begin", range(1, 7))
def test_begins_in_the_middle_of_a_frame(low: int, begin: int) -> None:
    channels = (0x0200 | low,)
    parser = Parser()
    assert parser.feed((encode(channels) * 3)[begin:]) == [Frame(channels)] * 2
    assert parser.counters.dropped_bytes == 7 - begin


@pytest.mark.parametrize(
    "bad, reason",
    [
        (b"xyz", "noise"),
        (b"S\x03\x00\x01\x02E\n\r", "length"),
        (b"S\x00E\n\r", "length"),
        (b"S\x12" + bytes(18) + b"E\n\r", "length"),
        (b"S\x02\x04\x00E\n\r", "value"),
        (b"S\x02\x00\x01E\r\n", "trailer"),
        (b"S\x02\x00\x01\x45\x45\n\r", "trailer"),
    ],
)
def test_what_is_bad_is_dropped_and_counted(bad: bytes, reason: str) -> None:
    parser = Parser()
    assert parser.feed(bad + encode([7])) == [Frame((7,))]
    dropped = parser.counters.dropped
    assert dropped[reason] >= 1
    assert sum(dropped.values()) == parser.counters.dropped_bytes == len(bad)
    assert set(name for name, number in dropped.items() if number) <= {reason, "noise"}


@given(st.lists(counts, max_size=10), st.lists(st.integers(0, 300), max_size=20))
def test_frames_survive_any_split(samples: List[List[int]], cuts: List[int]) -> None:
    parser = Parser()
    data = b"".join(encode(sample) for sample in samples)
    assert feed_in_pieces(parser, data, cuts) == [Frame(tuple(sample)) for sample in samples]
    assert parser.counters.dropped_bytes == parser.pending_bytes == 0
    assert parser.counters.frames == len(samples)


@given(st.lists(st.one_of(noise, counts.map(encode)), max_size=12), st.lists(st.integers(0, 400)))
def test_every_byte_is_accounted_for(pieces: List[bytes], cuts: List[int]) -> None:
    whole, split = Parser(), Parser()
    data = b"".join(pieces)
    frames = whole.feed(data)
    assert feed_in_pieces(split, data, cuts) == frames
    assert split.counters == whole.counters
    used = sum(len(encode(frame.channels)) for frame in frames)
    assert used + whole.counters.dropped_bytes + whole.pending_bytes == len(data)
    assert whole.pending_bytes < MAX_FRAME_BYTES
    assert all(encode(frame.channels) in data for frame in frames)


@given(noise, counts)
def test_finds_the_next_frames_after_noise(disturbance: bytes, sample: List[int]) -> None:
    parser = Parser()
    frames = parser.feed(disturbance + encode(sample) * 8)
    # Noise may swallow what its last bytes make a false start of, but no more than one longest
    # frame.
    lost = -(-MAX_FRAME_BYTES // len(encode(sample)))
    assert frames[-(8 - lost) :] == [Frame(tuple(sample))] * (8 - lost)


@given(counts, counts, st.integers(1, 22))
def test_a_cut_line_spoils_at_most_the_frame_that_it_cut(
    before: List[int], after: List[int], cut: int
) -> None:
    parser = Parser()
    parser.feed(encode(before)[:cut])
    parser.reset()
    assert parser.pending_bytes == 0
    assert parser.feed(encode(after)) == [Frame(tuple(after))]


def flips(data: bytes, count: int) -> Iterator[bytes]:
    """Yield the bytes with every choice of so many bits flipped."""
    for bits in combinations(range(8 * len(data)), count):
        changed = bytearray(data)
        for bit in bits:
            changed[bit // 8] ^= 1 << bit % 8
        yield bytes(changed)


@pytest.mark.parametrize("channels", [(600,), (0, 1023), (0x0253, 0x0343, 0x0145)])
@pytest.mark.parametrize("count", [1, 2])
def test_no_flipped_bits_pass_a_checksum_for_a_value(channels: Tuple[int, ...], count: int) -> None:
    """Every one and every two of a frame between two good ones."""
    good = encode(channels, checked=True)
    for bad in flips(good, count):
        frames = Parser(checked=True).feed(good + bad + good + bytes(MAX_FRAME_BYTES))
        assert set(frames) == {Frame(channels)} and len(frames) >= 1


def test_random_noise_passes_a_checksum_no_oftener_than_16_bits_let_it() -> None:
    """Frames whose number, data and checksum are random, their framing right: seeded."""
    dice = random.Random(7)
    trials, passed = 200_000, 0
    for _ in range(trials):
        body = bytes([2, dice.randrange(4), *dice.getrandbits(24).to_bytes(3, "big")])
        passed += bool(Parser(checked=True).feed(b"C" + body + b"E\n\r"))
    assert passed <= 12  # 3.05 are to be expected


def test_how_often_a_flipped_bit_in_the_papers_frame_is_a_wrong_value() -> None:
    """The share that the documentation states: 20 of the 72 bits are the two values'."""
    wrong = total = 0
    for count in range(0, 1024, 11):
        for bad in flips(encode([count, 760]), 1):
            frames = Parser().feed(bad)
            wrong += any(frame.channels != (count, 760) for frame in frames)
            total += 1
    assert wrong / total == pytest.approx(20 / 72)


@given(st.lists(counts, max_size=10), st.lists(st.integers(0, 300), max_size=20))
def test_checked_frames_survive_any_split(samples: List[List[int]], cuts: List[int]) -> None:
    parser = Parser(checked=True)
    data = b"".join(encode(sample, checked=True) for sample in samples)
    assert feed_in_pieces(parser, data, cuts) == [Frame(tuple(sample)) for sample in samples]
    assert parser.counters.dropped_bytes == parser.pending_bytes == 0


def test_each_parser_takes_its_own_sort_alone() -> None:
    for checked in (False, True):
        parser = Parser(checked)
        assert parser.feed(encode([600], not checked) * 20) == []
        assert parser.feed(encode([601], checked)) == [Frame((601,))]


def test_a_wrong_checksum_is_counted() -> None:
    good = encode([600], checked=True)
    assert good == b"C\x02\x02\x58\x1f\x63E\n\r"
    parser = Parser(checked=True)
    assert parser.feed(good[:3] + b"\x59" + good[4:]) == []
    assert parser.counters.dropped["checksum"] == 1
    parser = Parser(checked=True)
    assert parser.feed(good[:-1] + b"X") == [] and parser.counters.dropped["trailer"] == 1

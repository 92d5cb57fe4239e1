"""Every fault makes of a sound stream what its word says; the same seed, the same stream."""
import math
from dataclasses import replace
from typing import Dict, List, Tuple

import pytest
from hypothesis import given, settings, strategies as st

from shsa_injection.faults import MESSAGE_FAULTS, Reading, Stream, Timed, message_fault
from shsa_injection.line_faults import LINE_FAULTS, line_fault
from shsa_injection.vocabulary import FAULTS, Place

PERIOD_S = 0.02
STREAM = Stream(PERIOD_S, ((-5.0, 35.0), None))
COUNT = 500
SEEDS = range(20)
VALUE_FAULTS = {"stuck", "garbage", "wrong", "nan", "inf"}


def sound(count: int = COUNT) -> List[Timed]:
    """Return a sound stream: two values and a stamp."""
    return [
        (n * PERIOD_S, Reading((10.0 + math.sin(n), float(n)), 1000.0 + n * PERIOD_S, "laser"))
        for n in range(count)
    ]


def faulty(word: str, seed: int, stream: Stream = STREAM) -> List[List[Timed]]:
    """Return what comes instead of each message of a sound stream."""
    fault = message_fault(word, seed, stream)
    return [fault.feed(at, reading) for at, reading in sound()]


def flat(rows: List[List[Timed]]) -> List[Timed]:
    return [each for row in rows for each in row]


def test_every_word_of_messages_and_lines_has_a_class() -> None:
    words: Dict[Place, set] = {}
    for word, fault in FAULTS.items():
        words.setdefault(fault.place, set()).add(word)
    assert words[Place.MESSAGES] == set(MESSAGE_FAULTS)
    assert words[Place.LINE] == set(LINE_FAULTS)


@pytest.mark.parametrize("word", MESSAGE_FAULTS)
def test_the_same_seed_makes_the_same_stream_and_another_one_differs(word: str) -> None:
    assert repr(faulty(word, 7)) == repr(faulty(word, 7))
    streams = {repr(faulty(word, seed)) for seed in SEEDS}
    assert len(streams) > 1 or word == "stuck"


@pytest.mark.parametrize("word", MESSAGE_FAULTS)
def test_nothing_comes_before_its_message_and_values_change_in_their_faults_alone(
    word: str,
) -> None:
    for seed in SEEDS:
        for (at, reading), row in zip(sound(), faulty(word, seed)):
            assert all(when >= at for when, _ in row)
            if word not in VALUE_FAULTS:
                assert all(each.values == reading.values for _, each in row)


@pytest.mark.parametrize("word", MESSAGE_FAULTS)
def test_the_faulty_stream_is_not_the_sound_one(word: str) -> None:
    for seed in SEEDS:
        assert repr(flat(faulty(word, seed))) != repr(sound())


def test_stuck_keeps_the_first_values_and_lets_the_stamps_go_on() -> None:
    rows = flat(faulty("stuck", 0))
    assert {reading.values for _, reading in rows} == {(10.0, 0.0)}
    assert [reading.stamp for _, reading in rows] == [r.stamp for _, r in sound()]


def test_garbage_is_finite_and_mostly_out_of_range() -> None:
    values = [reading.values[0] or 0.0 for _, reading in flat(faulty("garbage", 1))]
    assert all(map(math.isfinite, values))
    assert sum(not -5.0 <= value <= 35.0 for value in values) > COUNT / 2


@given(st.integers(0, 2**31), st.floats(-5.0, 35.0))
@settings(max_examples=200, deadline=None)
def test_wrong_stays_within_the_range_and_is_off_by_a_tenth_of_it_or_more(
    seed: int, value: float
) -> None:
    ((_, reading),) = message_fault("wrong", seed, STREAM).feed(0.0, Reading((value, value)))
    off, free = reading.values
    assert off is not None and -5.0 <= off <= 35.0 and abs(off - value) >= 3.999
    assert free is not None and free != value


def test_slow_lets_one_in_some_through() -> None:
    counts = {len(flat(faulty("slow", seed))) for seed in SEEDS}
    assert counts == {COUNT // 2, math.ceil(COUNT / 3), COUNT // 4}


def test_delayed_keeps_order_and_stamps() -> None:
    for seed in SEEDS:
        rows = flat(faulty("delayed", seed))
        late = [when - at for (when, _), (at, _) in zip(rows, sound())]
        assert max(late) - min(late) < 1e-9 and 0.5 <= late[0] <= 2.0
        assert [each for _, each in rows] == [each for _, each in sound()]


def test_intermittent_begins_with_silence_and_comes_and_goes() -> None:
    for seed in SEEDS:
        there = [bool(row) for row in faulty("intermittent", seed)]
        changes = sum(a != b for a, b in zip(there, there[1:]))
        assert not there[0] and changes >= 6  # 10 s, at most 1 s each way
        assert 0 < sum(there) < COUNT


def test_fast_spreads_over_the_period_with_stamps_of_their_own() -> None:
    for seed in SEEDS:
        rows = faulty("fast", seed)
        assert 2 <= len(rows[0]) <= 5
        assert all(at < PERIOD_S for at, _ in rows[0])
        stamps = [reading.stamp or 0.0 for _, reading in flat(rows)]
        assert len(set(stamps)) == len(stamps) and stamps == sorted(stamps)


@pytest.mark.parametrize("word", ["nan", "inf"])
def test_not_a_number_is_in_the_first_message_and_in_a_share_of_all(word: str) -> None:
    test = math.isnan if word == "nan" else math.isinf
    shares = set()
    for seed in SEEDS:
        hits = [test(each.values[0] or 0.0) for _, each in flat(faulty(word, seed))]
        assert hits[0]
        shares.add(round(sum(hits) / COUNT, 1))
    assert shares == {1.0, 0.5, 0.1}


@pytest.mark.parametrize("word, sign", [("old_stamp", -1), ("future_stamp", 1)])
def test_stamps_are_shifted_by_the_same_time(word: str, sign: int) -> None:
    for seed in SEEDS:
        pairs = zip(flat(faulty(word, seed)), sound())
        shifts = [(new.stamp or 0.0) - (old.stamp or 0.0) for (_, new), (_, old) in pairs]
        assert 1.0 <= sign * shifts[0] <= 10.0 and max(shifts) - min(shifts) < 1e-9


def test_a_wrong_frame_is_the_same_in_every_message_and_an_array_as_short() -> None:
    for seed in SEEDS:
        (frame,) = {each.frame for _, each in flat(faulty("wrong_frame", seed))}
        assert frame != "laser"
    assert {flat(faulty("short_array", seed))[0][1].share for seed in SEEDS} == {0.0, 0.5}


def test_duplicates_are_the_same_message_at_the_same_moment() -> None:
    for seed in SEEDS:
        for each, row in zip(sound(), faulty("duplicate", seed)):
            assert row == [each] * len(row) and 2 <= len(row) <= 4


@pytest.mark.parametrize("word", MESSAGE_FAULTS)
def test_messages_without_a_value_or_a_stamp_stay_so(word: str) -> None:
    fault = message_fault(word, 3, Stream(None, (None,)))
    for number in range(50):
        for _, reading in fault.feed(number * 0.1, Reading((None,))):
            assert replace(reading, share=1.0) == Reading((None,), None)


def received(word: str, seed: int) -> Tuple[int, List[bytes]]:
    fault = line_fault(word, seed)
    data = [bytes(range(n % 200, n % 200 + 12)) for n in range(300)]
    parts = [fault.feed(each) or b"" for each in data]
    return sum(map(len, data)), parts


def test_noise_flips_bits_and_loses_bytes() -> None:
    for seed in SEEDS:
        assert received("serial_noise", seed) == received("serial_noise", seed)
        came, parts = received("serial_noise", seed)
        assert 0.85 * came < len(b"".join(parts)) < came
    assert received("serial_noise", 1) != received("serial_noise", 2)


def test_a_silent_line_yields_nothing_and_an_unplugged_one_is_gone() -> None:
    assert line_fault("serial_silence", 0).feed(b"abc") == b""
    assert line_fault("serial_unplug", 0).feed(b"abc") is None

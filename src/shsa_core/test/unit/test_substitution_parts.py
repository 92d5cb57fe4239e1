"""The parts of a substitute's core: schedule, inputs, program, signals as text, and stamps."""
import json
import math
import random
from dataclasses import replace
from itertools import chain, repeat
from typing import Any, Iterable, List, Optional

import pytest
from hypothesis import given, strategies as st
from substitute_driver import DEADLINE, IN, OUT, Driver, row, signal

from shsa_core.errors import ShsaError
from shsa_core.language.memory import longest_gap
from shsa_core.substitution.events import (
    ConsumerJoined,
    InputArrived,
    LastMessage,
    Publish,
    RowChanged,
    Tick,
)
from shsa_core.substitution.job import Job, Schedule, Stamps
from shsa_core.substitution.readings import Readings
from shsa_core.substitution.settings import MADE_UP_S
from shsa_core.substitution.signals import decode, encode


def test_the_first_is_due_at_once_and_then_one_a_period() -> None:
    schedule = Schedule(0.5, 10.0)
    assert schedule.due == 10.0
    schedule.done(10.1)
    assert schedule.due == 10.5
    schedule.done(10.7)
    assert schedule.due == 11.0


def test_what_is_late_is_not_followed_closely() -> None:
    schedule = Schedule(0.5, 10.0)
    schedule.done(10.3)
    assert schedule.due == 10.8
    schedule.done(99.0)
    assert schedule.due == 99.5


def published(schedule: Schedule, delays: Iterable[float], until: float) -> List[float]:
    """Return when its messages go, each so late after it is due."""
    found: List[float] = []
    for delay in delays:
        moment = schedule.due + delay
        if moment >= until:
            break
        found.append(moment)
        schedule.done(moment)
    return found


@pytest.mark.parametrize("worst", (0.0006, 0.0015, 0.003))
def test_at_1_khz_no_slot_is_lost_by_waking_late(worst: float) -> None:
    """Mostly in time, and every tenth time as late as `worst`."""
    numbers = random.Random(1)
    late = lambda: worst if numbers.random() < 0.1 else numbers.random() * 0.0001
    sent = published(Schedule(0.001, 0.0), iter(late, None), 10.0)
    assert abs(len(sent) - 10_000) <= 50
    assert min(b - a for a, b in zip(sent, sent[1:])) >= 0.0005 - 1e-9


@given(
    period=st.sampled_from((0.001, 0.002, 0.02, 0.1)),
    delays=st.lists(st.floats(0.0, 0.1), max_size=30),
    stall=st.floats(0.0, 10.0),
)
def test_a_stall_is_followed_by_no_burst(period: float, delays: List[float], stall: float) -> None:
    schedule = Schedule(period, 0.0)
    before = published(schedule, delays, math.inf)
    end = schedule.due + stall
    after = published(schedule, chain([stall], repeat(0.0)), end + 1.0)
    most = (MADE_UP_S + 1.0) / period + 2
    assert len(after) <= most + 1e-6
    sent = before + after
    assert all(b - a >= 0.5 * period - 1e-9 for a, b in zip(sent, sent[1:]))


def test_a_substitute_at_1_khz_that_wakes_late_now_and_then_keeps_its_rate() -> None:
    fast = replace(IN, period=0.001), replace(OUT, period=0.001)
    driver = Driver(row(True, inputs=fast[:1], outputs=fast[1:]))
    driver.ready()
    numbers = random.Random(2)
    while driver.time < 2.0:
        driver.arrive(driver.time)
        due = driver.core.next_deadline
        driver.time = max(driver.time, due) + (0.003 if numbers.random() < 0.05 else 0.00005)
        driver.tell(Tick)
    sent = driver.published()
    assert abs(len(sent) - 2000) <= 10
    assert all(moment - value <= 0.004 for moment, value in sent)


def test_without_a_period_only_what_begins_is_due() -> None:
    schedule = Schedule(None, 10.0)
    schedule.done(10.0)
    assert schedule.due == math.inf
    schedule.begin(12.0)
    assert schedule.due == 12.0


def take(
    inputs: Readings, time: float, topic: str, publisher: str, values: Any, age: int = 0
) -> None:
    """A message comes, whose stamp is so old, in ns."""
    now = 10**18
    inputs.take(InputArrived(time, topic, publisher, values, now - age, now))


def test_a_message_without_a_value_leaves_the_last_one_until_that_is_stale() -> None:
    inputs = Readings()
    inputs.listen([IN])
    take(inputs, 1.0, "/in", "/sensor", (("data", 7.0),))
    take(inputs, 1.0 + DEADLINE / 2, "/in", "/sensor", ())
    assert inputs.values([IN], 1.0 + DEADLINE) == (7.0,)
    assert inputs.values([IN], 1.001 + DEADLINE) is None


def test_a_value_counts_up_to_its_deadline() -> None:
    inputs = Readings()
    assert inputs.listen([IN, IN]) == [IN]
    assert inputs.listen([IN]) == []
    assert inputs.values([IN], 0.0) is None
    take(
        inputs,
        1.0,
        "/in",
        "/sensor",
        (
            ("data", 7.0),
            ("other", 8.0),
        ),
    )
    take(inputs, 1.0, "/elsewhere", "/sensor", (("data", 8.0),))
    assert inputs.values([IN], 1.0 + DEADLINE) == (7.0,)
    assert inputs.values([IN], 1.001 + DEADLINE) is None
    assert inputs.values([signal("/in", deadline=None)], 1e9) == (7.0,)
    assert inputs.values([], 0.0) == ()


def test_what_comes_after_a_silence_and_is_late_is_no_value() -> None:
    offset, cut_s = 5_000_000_000, 8.0
    inputs = Readings()
    inputs.listen([IN])
    take(inputs, 1.0, "/in", "/sensor", (("data", 1.0),), offset)
    back = 1.0 + cut_s
    for age in (cut_s, cut_s / 2, 1.1 * DEADLINE):
        take(inputs, back, "/in", "/sensor", (("data", 2.0),), offset + int(1e9 * age))
        assert inputs.values([IN], back) is None
    take(inputs, back, "/in", "/other", (("data", 4.0),), int(1e9 * cut_s))
    assert inputs.values([IN], back) == (4.0,)
    take(inputs, back + 0.1, "/in", "/sensor", (("data", 3.0),), offset)
    assert inputs.values([IN], back + 0.1) == (3.0,)


def test_a_clock_that_was_set_during_a_silence_holds_nothing_up_for_longer_than_that() -> None:
    inputs = Readings()
    inputs.listen([IN])
    take(inputs, 1.0, "/in", "/sensor", (("data", 1.0),))
    for step in range(21):
        take(inputs, 3.0 + 0.1 * step, "/in", "/sensor", (("data", 2.0),), 10**10)
    assert inputs.values([IN], 5.0) == (2.0,)


def test_the_time_in_which_nothing_is_told_is_no_silence() -> None:
    """A clock is set while it is muted, and is told the newest message now and then."""
    inputs, now, pause = Readings(), 10**18, DEADLINE + 0.02
    inputs.listen([IN])
    for turn in range(20):
        stamp = now if turn < 10 else now - 10**10
        told = turn * pause, "/in", "/sensor", (("data", float(turn)),), stamp, now
        inputs.take(InputArrived(*told, pause - 0.02))
        assert inputs.values([IN], turn * pause) == (float(turn),)


def test_a_signal_of_one_node_takes_its_messages_alone() -> None:
    inputs = Readings()
    named, anybody = signal("/in", node="/left"), signal("/in")
    inputs.listen([named, anybody])
    take(inputs, 0.0, "/in", "/right", (("data", 1.0),))
    assert inputs.values([anybody], 0.0) == (1.0,)
    assert inputs.values([named], 0.0) is None
    take(inputs, 0.0, "/in", "/left", (("data", 2.0),))
    assert inputs.values([named, anybody], 0.0) == (2.0, 2.0)


def test_a_long_gap_makes_derivatives_start_anew_and_is_measured_in_periods() -> None:
    code = "t0=x[0];\ndef _tf1(i1): return derivative(i1)\nt1=_tf1(t0);\ny=t1"
    for period, gap in ((0.01, 1.0), (1.0, 10.0), (None, math.inf)):
        job = Job(row(code=code, outputs=(signal("/out", period=period),)), 0.0)
        assert longest_gap(period) == gap
        job.evaluate((0.0,), 0.0)
        assert job.latest is None
        job.evaluate((5.0,), 5.0)
        assert (job.latest is None) == (gap < 5.0)


def test_a_job_follows_the_numbers_of_its_own_program_alone() -> None:
    job = Job(row(), 0.0)
    assert job.follow(row(outputs=(signal("/out", period=3.0),)), 0.0) and job.period == 3.0
    assert not job.follow(row(code="t0=x[0];y=t0;"), 0.0)
    assert not job.follow(row(inputs=(signal("/in", node="/left"),)), 0.0)


def test_what_is_computed_is_published_as_it_is_calibrated() -> None:
    calibrated = replace(signal("/out"), gain=1.2, offset=0.5)
    job = Job(row(code="t0=x[0];y=t0;"), 0.0)
    job.evaluate((5.0,), 1.0)
    assert job.latest == (5.0,)
    assert job.follow(row(code="t0=x[0];y=t0;", outputs=(calibrated,)), 0.0)
    job.evaluate((5.0,), 2.0)
    assert job.latest == (6.5,)
    job.evaluate((1.6e308,), 3.0)
    assert job.latest is None


def test_an_angle_whose_last_good_one_nobody_knows_is_that_of_the_program() -> None:
    job = Job(row(code="t0=x[0];y=t0;", outputs=(signal("/out", field="yaw(orientation)"),)), 0.0)
    job.evaluate((0.5,), 1.0)
    assert job.latest == (0.5,)


def test_an_angle_of_another_zero_goes_on_from_the_last_good_one() -> None:
    field = "yaw(pose.pose.orientation)"
    out = signal("/out", field=field)
    job = Job(row(code="t0=x[0];y=t0;", outputs=(out,)), 0.0)
    job.start([(field, 0.5)])
    found: List[float] = []
    for step in range(3):
        job.evaluate((0.5 + 2.42 + 0.01 * step,), float(step + 1))
        found += job.latest or ()
    assert found == pytest.approx([0.5, 0.51, 0.52])
    calibrated = row(code="t0=x[0];y=t0;", outputs=(replace(out, offset=-2.42),))
    assert job.follow(calibrated, 4.0)
    job.evaluate((2.95,), 5.0)
    assert job.latest == pytest.approx((0.53,))


PASSED_ON = """t0=x[0]; t1=x[1];
def _tf1(i1,i2): return integral(i1*cos(i2))
t2=_tf1(t0,t1)
def _tf2(i1,i2): return integral(i1*sin(i2))
t3=_tf2(t0,t1)
y=(t2,t3,t1)"""
COMPUTED = """t0=x[0]; t1=x[1];
def _tf1(i1): return i1 + 1.0
t2=_tf1(t1)
def _tf2(i1,i2): return integral(i1*cos(i2))
t3=_tf2(t0,t2)
def _tf3(i1,i2): return integral(i1*sin(i2))
t4=_tf3(t0,t2)
y=(t3,t4,t2)"""


@pytest.mark.parametrize("learned", [0.0, -2.42])
@pytest.mark.parametrize(
    "zero, code", [(2.42, PASSED_ON), (1.42, COMPUTED)], ids=["passed on", "computed"]
)
def test_a_place_is_integrated_along_the_angle_that_is_published(
    zero: float, code: str, learned: float
) -> None:
    field = "yaw(pose.pose.orientation)"
    places = [signal("/odom", field=name) for name in ("x", "y")]
    angle = replace(signal("/odom", field=field), offset=learned)
    inputs = (signal("/speed"), signal("/imu"))
    job = Job(row(code=code, inputs=inputs, outputs=(*places, angle)), 0.0)
    job.evaluate((1.0, zero - 0.5), 0.5)  # hot: it has computed before
    heading = 0.3
    job.start([("x", 5.0), ("y", -2.0), (field, heading)])
    found = []
    for step in range(3):
        job.evaluate((1.0, zero + heading), 1.0 + 0.1 * step)
        found.append(job.latest or ())
    assert [each[2] for each in found] == pytest.approx([heading] * 3)
    (x, y, *_), (end_x, end_y, *_) = found[0], found[-1]
    assert math.hypot(x - 5.0, y + 2.0) < 0.6
    assert math.atan2(end_y - y, end_x - x) == pytest.approx(heading)


@pytest.mark.parametrize(
    "law, integrates", [("i1", False), ("integral(i1)", True), ("1.0+integral(i1)", True)]
)
def test_a_sum_is_as_good_as_where_it_started(law: str, integrates: bool) -> None:
    code = f"t0=x[0];\ndef _tf1(i1): return {law}\nt1=_tf1(t0);\ny=t1"
    assert Job(row(code=code), 0.0).integrates is integrates


def test_signals_survive_the_way_as_text() -> None:
    inputs = (IN, signal("/x", None, None, "/left", "a.b[3]", "pkg/Type"))
    assert decode(encode(inputs, (OUT,))) == (inputs, (OUT,))


BAD_KEYS: List[Any] = [
    *({"node": 5}, {"latched": 1}, {"field": "x;y"}, {"period": "1"}, {"period": 0.0}),
    *({"period": -1.0}, {"period": "nan"}, {"gain": 0.0}, {"gain": -1.0}, {"gain": "nan"}),
    *({"offset": "inf"}, {"offset": "0"}, {"color": "red"}),
]


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "[[], [], []]", "[[1], []]", '[[["/a"]], []]']
    + [json.dumps([[{**json.loads(encode([IN], []))[0][0], **bad}], []]) for bad in BAD_KEYS],
)
def test_what_is_no_signals_is_refused(text: str) -> None:
    with pytest.raises(ShsaError, match="SHSA_SIGNALS holds no signals"):
        decode(text)


# Stamps.

START = 1_700_000_000_000_000_000


def at(time: float) -> int:
    """ROS time of the driver's clock, in ns."""
    return START + int(round(time * 1e9))


def stamps(driver: Driver) -> List[int]:
    """The stamps of what was published."""
    return [c.stamp for _, c in driver.said if isinstance(c, Publish)]


def hear(driver: Driver, topic: str, stamp: int) -> None:
    """An input comes now with this stamp."""
    driver.tell(InputArrived, topic, "/sensor", (("data", 1.0),), stamp, at(driver.time))


TWO = "t0=x[0]; t1=x[1];\ndef _tf1(i1,i2): return i1+i2\nt2=_tf1(t0,t1);\ny=t2"


def test_the_stamp_is_that_of_the_oldest_input() -> None:
    inputs = (signal("/a"), signal("/b", deadline=1.0))
    driver = Driver(row(True, inputs, TWO))
    driver.ready()
    driver.time = 1.0
    hear(driver, "/b", at(0.5))
    hear(driver, "/a", at(0.9))
    assert stamps(driver) == [at(0.5)]
    driver.time = 1.1
    hear(driver, "/b", 0)  # it has no header: it counts from its arrival
    driver.pass_to(1.12)
    assert stamps(driver)[-1] == at(0.9)


@pytest.mark.parametrize("deadline, stamp", [(DEADLINE, 0.9), (None, 0.5)])
def test_a_value_that_holds_until_the_next_one_makes_no_stamp_old(
    deadline: Optional[float], stamp: float
) -> None:
    inputs = (signal("/a", deadline=deadline), signal("/b", None, None))
    driver = Driver(row(True, inputs, TWO))
    driver.ready()
    hear(driver, "/b", at(0.0))
    driver.time = 0.5
    hear(driver, "/b", at(0.5))
    driver.time = 0.9
    hear(driver, "/a", at(0.9) if deadline else at(0.3))
    assert stamps(driver) == [at(stamp)]


def test_a_stamp_is_neither_newer_than_now_nor_older_than_the_one_before() -> None:
    driver = Driver(row())
    driver.ready()
    driver.time = 1.0
    taken, last = replace(row(True), last_message=b"m"), LastMessage((("data", 1.0),), at(0.98))
    driver.tell(RowChanged, taken, (), last)
    hear(driver, "/in", at(0.90))
    assert stamps(driver) == [at(0.98)]
    driver.time = 1.02
    hear(driver, "/in", at(5.0))
    assert stamps(driver) == [at(0.98), at(1.02)]
    driver.time = 1.04
    hear(driver, "/in", at(1.0))
    assert stamps(driver)[-1] == at(1.02)


def test_who_joins_hears_the_same_message_with_the_same_stamp() -> None:
    driver = Driver(row(True))
    driver.ready()
    driver.time = 1.0
    hear(driver, "/in", at(0.9))
    driver.time = 1.01
    (message,) = driver.tell(ConsumerJoined, "/out", "/late")
    assert (message.only, message.stamp) == ("/late", at(0.9))


def test_a_clock_that_is_set_back_does_not_stop_the_stamps() -> None:
    stamps_ = Stamps()
    stamps_.clock(1.0, at(100.0))
    assert stamps_.of("/a", at(100.0), 1.0) == at(100.0)
    stamps_.clock(1.1, at(50.0))
    assert stamps_.of("/a", at(50.0), 1.1) == at(50.0)


def test_what_stands_on_nothing_measured_is_stamped_now() -> None:
    stamps_ = Stamps()
    assert stamps_.of("/a", 0, 1.0) == 0, "the shell's now"
    stamps_.clock(1.0, at(1.0))
    assert stamps_.of("/a", 0, 1.5) == at(1.5)

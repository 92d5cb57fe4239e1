"""The gate's core: what consumers hear, message by message, and who speaks to them."""
import io
import math
from dataclasses import replace
from typing import Any, Dict, List, Optional

import pytest
import rospy
from hypothesis import given, strategies as st
from gate_stand import (
    FIRST,
    GATED,
    HIGH,
    LOW,
    NODE,
    NS,
    PERIOD,
    RAW,
    SUBSTITUTE,
    Stand,
    overheard,
    provision,
    row,
    with_value_checks,
)
from rospy.msg import serialize_message
from shsa_msgs.msg import Float64Stamped
from std_msgs.msg import Header

from shsa_core.model.checks import LEARNED, Jump, Stuck, Witness
from shsa_core.model.error import Error
from shsa_core.monitoring.events import Disconnected, SubstitutionsChanged
from shsa_core.ros.messages.fields import stamp as stamp_of
from shsa_core.ros.rospy_patches.publishing import as_written
from shsa_gate.events import Pass


@pytest.fixture
def stand() -> Stand:
    stand = Stand()
    stand.substitute()
    return stand


def test_good_messages_pass_at_once_and_as_they_are() -> None:
    stand = Stand()
    assert stand.message(1.0) == [Pass(b"1.0 /amperemeter", NODE)]
    stand.until(PERIOD)
    assert stand.message(1.0) == [Pass(b"1.0 /amperemeter", NODE)]


@pytest.mark.parametrize("bad", [math.nan, math.inf, 61.0, -5.1])
def test_one_bad_message_is_replaced_at_once(stand: Stand, bad: float) -> None:
    stand.run(10, [1.0] * 5 + [bad] + [1.0] * 4)
    assert stand.values() == [1.0] * 5 + [2.0] + [1.0] * 4
    assert stand.gap() == pytest.approx(PERIOD)


def test_a_lasting_fault_is_replaced_until_it_is_good_for_long_enough(stand: Stand) -> None:
    stand.run(40, [1.0] * 5 + [61.0] * 10 + [1.0] * 25)
    assert stand.values()[:5] == [1.0] * 5 and stand.values()[-1] == 1.0
    assert stand.values().count(1.0) == 26 and set(stand.values()) == {1.0, 2.0}
    assert stand.gap() <= 1.5 * PERIOD + 1e-9
    assert "is not heard now: battery_current is 61" in stand.said[0]
    assert "is good again" in stand.said[1]


def test_without_a_substitute_bad_messages_are_missing_and_no_more() -> None:
    stand = Stand()
    stand.run(10, [1.0] * 5 + [math.nan] + [3.0] * 4, None)
    assert stand.values() == [1.0] * 5 + [3.0] * 4


@pytest.mark.parametrize("phase", [0.0, 0.2, 0.4, 0.6, 0.9])
def test_a_silent_node_leaves_a_gap_of_a_period_and_a_half(phase: float) -> None:
    stand = Stand()
    stand.substitute()
    stand.run(10, phase=phase)
    stand.run(20, None, phase=phase)
    stand.run(5, phase=phase)
    assert stand.gap() <= 1.5 * PERIOD + 1e-9
    counts = len(stand.heard)
    assert 34 <= counts <= 36


def test_while_the_table_says_so_the_node_is_not_believed(stand: Stand) -> None:
    stand.run(5)
    stand.substitute(publishing=True)
    stand.run(10)
    assert stand.values()[5:] == [2.0] * 10
    stand.substitute()
    stand.run(5)
    assert stand.values()[-5:] == [1.0] * 5
    assert stand.gap() <= 1.5 * PERIOD + 1e-9


def test_a_substitute_that_is_gone_leaves_the_node_to_its_checks(stand: Stand) -> None:
    stand.substitute(publishing=True)
    stand.run(3)
    stand.substitute(gone=True)
    stand.run(3, substitute=None)
    assert stand.values()[-3:] == [1.0] * 3


@pytest.mark.parametrize("bad", [math.nan, 61.0])
def test_a_substitutes_bad_value_is_not_heard(stand: Stand, bad: float) -> None:
    stand.run(5)
    stand.run(5, None, bad)
    assert stand.values() == [1.0] * 5 + [2.0]  # the last good one, while it is fresh


def test_an_old_value_of_a_substitute_is_not_heard(stand: Stand) -> None:
    stand.run(5)
    stand.run(10, substitute=None)
    stand.run(5, math.nan, None)
    assert stand.values() == [1.0] * 15


@pytest.mark.parametrize("age, heard", [(2.0, True), (2.1, False)])
def test_a_substitutes_value_is_heard_for_two_periods(
    stand: Stand, age: float, heard: bool
) -> None:
    stand.message(2.0, SUBSTITUTE)
    for part in (1, 2):
        stand.until(part * age / 3.0 * PERIOD)
        stand.message(1.0)
    stand.until(age * PERIOD)
    assert bool(stand.message(math.nan)) is heard


def test_strangers_are_not_heard(stand: Stand) -> None:
    stand.run(100, None, None)
    for _ in range(150):
        stand.message(1.0, "/stranger")
        stand.until(stand.time + PERIOD)
    assert not stand.heard and not stand.said


def test_jumps_are_held_back() -> None:
    stand = Stand(replace(GATED, provides=(with_value_checks(Jump(5.0)),)))
    stand.substitute()
    stand.run(30, [1.0] * 5 + [20.0] + [1.0] * 4 + [30.0] * 20)
    assert stand.values()[:10] == [1.0] * 5 + [2.0] + [1.0] * 4
    assert 30.0 not in stand.values()[:12]
    assert stand.values()[-1] == 30.0  # it is steady there


def test_a_stuck_value_is_held_back_once_that_is_known() -> None:
    stand = Stand(replace(GATED, provides=(provision(Stuck(0.2)),)))
    stand.substitute()
    stand.run(40, [float(i % 7) for i in range(10)] + [5.0] * 30)
    assert stand.values()[-10:] == [2.0] * 10  # which never changes: only the node must


def test_of_a_node_that_is_too_fast_only_what_the_som_allows_passes(stand: Stand) -> None:
    for _ in range(2000):
        stand.until(stand.time + PERIOD / 10)
        stand.message(1.0)
    assert len(stand.heard) <= 1.5 * 200 + 5


def test_messages_that_come_at_once_pass_up_to_a_burst(stand: Stand) -> None:
    assert [bool(stand.message(1.0)) for _ in range(7)] == [True] * 5 + [False] * 2


def test_a_node_that_never_spoke_is_filled_in_for_once_it_is_late(stand: Stand) -> None:
    stand.run(3, None)
    assert stand.values() == [2.0, 2.0] and stand.heard[0][0] == pytest.approx(1.5 * PERIOD)


def test_a_whole_table_has_no_other_substitutes(stand: Stand) -> None:
    stand.substitute(publishing=True)
    stand.feed(SubstitutionsChanged(stand.time, (), whole=True))
    stand.run(5)
    assert stand.values() == [1.0] * 5


def test_what_is_just_not_late_is_heard_though_something_newer_has_come(stand: Stand) -> None:
    assert stand.message(1.0, waited=1.5 * PERIOD, newest=False)
    assert not stand.message(1.0, waited=1.6 * PERIOD, newest=False)


def test_what_a_held_up_gate_reads_late_is_not_poured_out(stand: Stand) -> None:
    stand.run(5)
    stand.until(stand.time + 1.0)
    before = len(stand.heard)
    for i in range(50):
        stand.message(1.0, waited=1.0, newest=i == 49)
    assert len(stand.heard) == before + 1


def test_stamps_grow_across_substitute_and_node(stand: Stand) -> None:
    lag = 5 * round(PERIOD * NS)  # the node stamps what it measured, its substitute what it read
    now = lambda: round((stand.time + 100.0) * NS)
    for i in range(60):
        begin = stand.time
        if not (10 <= i < 20 or i in (30, 40)):
            stand.message(1.0, stamp=now() - lag)
        elif i >= 30:
            stand.message(math.nan, stamp=now() - lag)
        stand.until(begin + 0.4 * PERIOD)
        stand.message(2.0, SUBSTITUTE, stamp=now())
        stand.until(begin + PERIOD)
    times = []
    for (_, each), value in zip(stand.heard, stand.values()):
        if each.stamp is not None:
            times.append(each.stamp)
    assert stand.values().count(1.0) == 48, "the node came back each time, at once"
    assert times == sorted(times) and stand.gap() <= 1.5 * PERIOD + 1e-9


@pytest.mark.parametrize("standby_for", ["", FIRST])
def test_who_stamps_earlier_than_a_substitute_that_spoke_first_is_heard(standby_for: str) -> None:
    stand = Stand(standby_for=standby_for)
    stand.substitute()
    for i in range(40):
        begin, stamp = stand.time, round((stand.time + 100.0 - 5 * PERIOD) * NS)
        if standby_for and i < 10:
            stand.feed(overheard(begin, FIRST, stamp))
        if standby_for or i >= 10:
            stand.message(1.0, stamp=stamp)
        stand.until(begin + 0.4 * PERIOD)
        stand.message(2.0, SUBSTITUTE, stamp=round((stand.time + 100.0) * NS))
        stand.until(begin + PERIOD)
    assert 2.0 in stand.values() and stand.values()[-20:] == [1.0] * 20


def test_what_a_node_held_that_hung_makes_no_substitutes_stamps_late(stand: Stand) -> None:
    now = lambda: round((stand.time + 100.0) * NS)
    stand.substitute()
    for i in range(200):
        begin = stand.time
        if i < 50 or i == 95:  # one more comes after 0.9 s
            stand.message(1.0, stamp=now() if i < 50 else round((50 * PERIOD + 100.0) * NS))
        stand.until(begin + 0.4 * PERIOD)
        stand.message(2.0, SUBSTITUTE, stamp=now())
        stand.until(begin + PERIOD)
    ages = [at + 100.0 - each.stamp / NS for at, each in stand.heard if each.stamp]
    assert len(ages) > 100 and max(ages[-90:]) < 0.1


def test_a_substitutes_stamp_is_no_newer_than_that_of_the_missing_message(stand: Stand) -> None:
    lag = 5 * round(PERIOD * NS)
    stand.message(1.0, stamp=100 * NS)
    stand.until(PERIOD)
    stand.message(2.0, SUBSTITUTE, stamp=100 * NS + lag)
    (filled,) = stand.message(math.nan, stamp=100 * NS + 1)
    assert filled.stamp == 100 * NS + round(PERIOD * NS)


def test_a_substitutes_older_stamp_is_made_newer_than_what_was_heard(stand: Stand) -> None:
    stand.message(1.0, stamp=1000 * NS)
    stand.substitute(publishing=True)
    stand.until(PERIOD)
    (passed,) = stand.message(2.0, SUBSTITUTE, stamp=1000 * NS - 100)
    assert passed.stamp == 1000 * NS + 1


def test_a_second_in_which_stamps_go_back_is_no_clock_that_was_set(stand: Stand) -> None:
    for back, passes in ((NS - 1, False), (NS, True)):
        stand.substitute(publishing=True)
        stand.until(stand.time + PERIOD)
        stand.message(2.0, SUBSTITUTE, stamp=1000 * NS)
        stand.substitute()
        stand.until(stand.time + PERIOD)
        assert bool(stand.message(1.0, stamp=1000 * NS - back)) is passes


def test_a_clock_that_was_set_locks_nobody_out(stand: Stand) -> None:
    stand.message(1.0, stamp=1000 * NS)
    stand.until(2 * PERIOD)
    stand.message(2.0, SUBSTITUTE, stamp=1000 * NS + 5)
    stand.until(3 * PERIOD)
    assert stand.message(1.0, stamp=500 * NS)


def test_an_event_driven_service_is_filtered_and_never_late() -> None:
    stand = Stand(replace(GATED, period=None))
    stand.substitute()
    assert stand.core.next_deadline == math.inf
    assert stand.message(1.0, stamp=5) and not stand.message(math.nan, stamp=6)
    stand.until(1.0)
    stand.message(2.0, SUBSTITUTE, stamp=9)
    assert [(each.publisher, each.stamp) for each in stand.message(math.nan, stamp=7)] == [
        (SUBSTITUTE, None)
    ]


def test_an_event_driven_value_of_a_substitute_is_heard_once_and_after_no_newer_one() -> None:
    stand = Stand(replace(GATED, period=None))
    stand.substitute()
    stand.until(1.0)
    stand.message(2.0, SUBSTITUTE)
    stand.until(599.0)
    assert stand.message(7.0)
    stand.until(600.0)
    assert not stand.message(math.nan), "the node has said something newer"
    stand.message(3.0, SUBSTITUTE)
    stand.until(601.0)
    assert stand.message(math.nan)
    stand.until(602.0)
    assert not stand.message(math.nan), "it was heard"


def test_what_goes_out_has_the_very_bytes_that_came() -> None:
    header = Header(seq=7, stamp=rospy.Time(5, 6), frame_id="f")
    message = Float64Stamped(header=header, data=1.5)
    came, goes = io.BytesIO(), io.BytesIO()
    message.serialize(came)
    serialize_message(goes, 99, as_written(Float64Stamped)(came.getvalue()))
    assert goes.getvalue()[4:] == came.getvalue()
    assert isinstance(as_written(Float64Stamped)(b""), Float64Stamped)
    assert stamp_of(came.getvalue()) == 5 * NS + 6


def test_of_a_substitute_single_values_are_judged_and_no_history(stand: Stand) -> None:
    node, substitute = map(stand.core.service_of, (NODE, SUBSTITUTE))
    assert node and node.checks.each
    assert substitute and not substitute.checks.each
    assert stand.core.service_of("/stranger") is None


# Any story.

VALUES = st.sampled_from([1.0, 59.0, -5.0, 60.5, -6.0, math.nan, math.inf, None])
STEPS = st.tuples(
    st.sampled_from(["node", "substitute", "stranger", "plays", "rests", "ends"]),
    VALUES,
    st.floats(0.0, 3 * PERIOD),
)


@given(st.lists(STEPS, max_size=60), st.booleans())
def test_no_story_lets_a_bad_value_through(steps: List[Any], standby: bool) -> None:
    stand = Stand(standby_for=FIRST if standby else "")
    stamp = 0
    for what, value, pause in steps:
        stand.until(stand.time + pause)
        stamp += round(pause * NS) + 1
        if what in ("plays", "rests", "ends"):
            stand.substitute(what == "plays", what == "ends")
        elif value is not None:
            names: Dict[str, str] = {"node": NODE, "substitute": SUBSTITUTE}
            stand.message(value, names.get(what, "/stranger"), stamp)
        elif standby:
            stand.feed(overheard(stand.time, FIRST, stamp))
    for value in stand.values():
        assert math.isfinite(value) and LOW <= value <= HIGH
    last: Optional[float] = None
    for time, each in stand.heard:
        substitutes = each.publisher == SUBSTITUTE
        assert not (substitutes and last is not None and time - last < PERIOD / 2 - 1e-9)
        last = time


def witnessed(limit: float = 4.0, **changes: Any) -> Stand:
    """A gate whose value has a witness, and whose node and substitute agree so far."""
    gated = replace(GATED, provides=(with_value_checks(Witness(limit)),))
    stand = Stand(gated)
    outputs = tuple(replace(each, **changes) for each in row(False).outputs)
    rows = (replace(row(False), outputs=outputs),)
    stand.feed(SubstitutionsChanged(0.0, rows))
    stand.run(10)
    return stand


@pytest.mark.parametrize(
    "stand, jump",
    [
        (witnessed(), 7.0),
        (witnessed(LEARNED, error=Error(1.0)), 7.0),
        (witnessed(LEARNED, error=Error(1.0)), -3.5),
    ],
)
def test_a_jump_that_the_substitute_did_not_see_does_not_pass(stand: Stand, jump: float) -> None:
    stand.run(200, jump)
    assert jump not in stand.values() and set(stand.values()[11:]) == {2.0}
    assert stand.gap() <= 1.5 * PERIOD + 1e-9
    stand.run(5)
    assert stand.values()[-5:] == [1.0] * 5
    assert stand.said == []


def test_what_the_monitor_does_not_confirm_is_believed_and_doubted_no_more() -> None:
    stand = witnessed()
    stand.run(400, 7.0)
    first = next(at for at, each in stand.heard if each.data.startswith(b"7.0"))
    assert first == pytest.approx(10 * PERIOD + 6.0, abs=3.0 * PERIOD)  # thirty looks on
    stand.run(50, 9.0)
    assert stand.values()[-50:] == [9.0] * 50


@pytest.mark.parametrize("original, substitute", [(1.0, 9.0), (9.0, 11.0)])
def test_where_the_substitute_moved_as_far_the_node_is_heard(
    original: float, substitute: float
) -> None:
    stand = witnessed()
    stand.run(1, substitute=substitute)
    stand.run(100, original, substitute)
    assert stand.values()[-100:] == [original] * 100


def test_without_known_errors_or_a_fresh_value_nobody_is_doubted() -> None:
    for stand, substitute in ((witnessed(LEARNED), 2.0), (witnessed(), None)):
        stand.run(4, substitute=substitute)
        stand.run(10, 7.0, substitute)
        assert stand.values()[-10:] == [7.0] * 10


def test_no_turn_through_pi_is_doubted() -> None:
    yaw = replace(with_value_checks(Witness(0.3)), field="yaw(pose.pose.orientation)")
    stand = Stand(replace(GATED, provides=(yaw,)))
    stand.substitute()
    turn = [math.remainder(0.01 * step, math.tau) for step in range(700)]
    stand.run(700, turn, [math.remainder(each - 0.05, math.tau) for each in turn])
    assert {each.publisher for _, each in stand.heard} == {NODE}


def test_another_process_of_the_node_is_not_held_to_what_the_first_did() -> None:
    stand = Stand()
    stand.substitute()
    stand.run(60)
    stand.run(10, 61.0)
    assert stand.values()[-5:] == [2.0] * 5
    stand.feed(Disconnected(stand.time, RAW, NODE))
    stand.run(5)
    assert stand.values()[-5:] == [1.0] * 5

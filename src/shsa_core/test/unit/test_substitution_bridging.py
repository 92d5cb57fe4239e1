"""A muted substitute fills in for an original that is late, and is still when that speaks."""
from dataclasses import replace
from typing import Any, List, Optional, Tuple

import pytest
from hypothesis import given, settings, strategies as st
from substitute_driver import PERIOD, Driver, idle, only, row, signal
from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import CHANGEOVER_S, Substitution
from shsa_core.substitution import events
from shsa_core.substitution.settings import ALONE_LOOKS, LATE, LOOK_AGAIN_S, STEADY
from shsa_testing.thorough import many

BRIDGE = 2.5 * PERIOD
LOOK = 0.0006
SETTLED = 10 * PERIOD
INTEGRAL = "t0=x[0];\ndef _tf1(i1): return integral(i1)\nt1=_tf1(t0);\ny=t1"


def bridges(publishing: bool = False, bridge: float = BRIDGE, **of: Any) -> Substitution:
    return replace(row(publishing, **of), bridge=bridge)


class Robot:
    """A substitute, its input that never stops, and an original; what a consumer hears of both."""

    def __init__(self, told: Optional[Substitution] = None, look: float = LOOK) -> None:
        told = bridges() if told is None else told
        self.driver = Driver(replace(told, publishing=False, bridge=0.0))
        self.driver.ready()
        self.driver.change(told)
        self.look, self.stands, self.source = look, True, "/sensor"
        self.alone = False
        """Whether the reconfigurator hears its heartbeats, and the monitor."""
        self.looks: List[Tuple[float, events.LookAtOthers]] = []
        self.original: List[float] = []
        self._input = 0.0

    @property
    def filled(self) -> List[float]:
        """Return when it filled in."""
        return [time for time, _ in self.driver.published()]

    @property
    def heard(self) -> List[Tuple[float, str]]:
        """Return what a consumer hears, in order."""
        ours = [(time, "substitute") for time in self.filled]
        return sorted([*ours, *((time, "original") for time in self.original)])

    def to(self, time: float) -> "Robot":
        """Let time pass, with inputs and looks."""
        while True:
            due = self.driver.core.next_deadline
            looked = self.looks[0][0] if self.looks else time + 1.0
            soonest = min(self._input, looked, due)
            if soonest > time:
                break
            self.driver.time = max(self.driver.time, soonest)
            if soonest == looked:
                answer = self.looks.pop(0)[1], self.stands, self.alone
                self._note(self.driver.tell(events.OthersStand, *answer))
            elif soonest == self._input:
                self._input = round(self._input + PERIOD, 9)
                if self.source:
                    self._note(self.driver.arrive(1.0, publisher=self.source))
            else:
                self._note(self.driver.tell(events.Tick))
        self.driver.time = time
        return self

    def stranger_speaks(self, at: float) -> "Robot":
        """A node publishes that the SOM does not name."""
        self.to(at)
        self._note(self.driver.tell(events.OtherHeard, "/out", "/stranger", 3))
        return self

    def speaks(self, at: float, topic: str = "/out") -> "Robot":
        """The original publishes."""
        self.to(at)
        self.original.append(round(at, 6))
        self._note(self.driver.tell(events.OtherHeard, topic, "/original", 7))
        return self

    def gone(self, at: float, node: str = "/original") -> "Robot":
        """The node of the original, or another one, is gone."""
        self.to(at)
        self._note(self.driver.tell(events.OtherGone, "/out", node))
        return self

    def stream(self, until: float, period: float = PERIOD) -> "Robot":
        """The original publishes periodically."""
        since = self.driver.time
        for turn in range(int(round((until - since) / period))):
            self.speaks(round(since + turn * period, 9))
        return self.to(until)

    def _note(self, commands: List[Any]) -> None:
        looks = only(commands, events.LookAtOthers)
        self.looks += [(self.driver.time + self.look, each) for each in looks]


@pytest.mark.parametrize("poll", (PERIOD, 4.9 * PERIOD, 5 * PERIOD))
def test_what_is_told_many_at_a_time_is_a_steady_pace_as_well(poll: float) -> None:
    """As a muted substitute hears it: when it wakes, each as of when the newest had come."""
    robot = Robot()
    core, woke, said = robot.driver.core, 0.0, 0.0
    looks: List[float] = []
    while woke < 100 * PERIOD:
        due = core.next_deadline
        woke = max(woke, min(woke + poll, due))
        count = int((woke - said) / PERIOD)
        said += count * PERIOD
        for _ in range(count if woke < 50 * PERIOD else 0):
            core.handle(events.OtherHeard(said, "/out", "/original", 7))
            last = said
        for command in core.handle(events.Tick(woke)):
            if isinstance(command, events.LookAtOthers):
                looks.append(woke)
    assert last + LATE * PERIOD - 1e-6 < looks[0] <= last + BRIDGE


def test_one_that_is_late_is_filled_in_for_at_its_period_and_takes_over_again_at_once() -> None:
    robot = Robot().stream(1.0).to(1.2)
    last = robot.original[-1]
    first = robot.filled[0]
    assert last + LATE * PERIOD < first <= last + BRIDGE + LOOK + 1e-4
    steps = [b - a for a, b in zip(robot.filled, robot.filled[1:])]
    assert len(steps) >= 6 and all(abs(step - PERIOD) < 1e-5 for step in steps)
    before = len(robot.filled)
    robot.stream(2.2)
    assert len(robot.filled) == before


def test_the_more_regular_a_stream_is_the_sooner_it_is_filled_in_for() -> None:
    robot = Robot().stream(20.0).to(20.2)
    assert robot.filled[0] == pytest.approx(robot.original[-1] + LATE * PERIOD + LOOK, abs=1e-3)
    robot = Robot()
    for _ in range(20):
        robot.stream(robot.driver.time + 1.0).to(robot.driver.time + 1.1 * PERIOD)
    assert len(robot.filled) <= 1, "a pause of 2.1 periods a second is how this one is"


def test_healthy_jittery_and_slow_originals_are_left_alone_or_filled_in_for_each_time() -> None:
    assert Robot().stream(2.0).filled == []
    half = Robot().stream(1.0).stream(3.0, 2 * PERIOD)
    assert len(half.filled) <= 2, "its pace is half from now on"
    slow = Robot().stream(1.0).stream(3.0, 5 * PERIOD)
    assert len(slow.filled) in range(38, 64)  # two or three in each of 20 gaps


@pytest.mark.parametrize("apart", [0.0, 0.001])
def test_who_sends_in_batches_is_not_filled_in_for(apart: float) -> None:
    batches = Robot()
    for number in range(50):
        for turn in range(10):
            batches.speaks(round(0.2 * number + turn * apart, 9))
    assert batches.filled == []


def test_who_makes_up_for_a_silence_is_filled_in_for_again_once_it_is_steady() -> None:
    robot = Robot().stream(1.0).to(1.4)
    bridged = len(robot.filled)
    for _ in range(20):
        robot.speaks(1.4)
    for number in range(7, 20):  # it sends batches from now on
        robot.to(0.2 * (number + 1)).speaks(0.2 * (number + 1)).speaks(0.2 * (number + 1))
    assert 16 <= bridged == len(robot.filled)
    last = robot.stream(5.0).original[-1]
    assert robot.to(5.2).filled[bridged] == pytest.approx(last + LATE * PERIOD + LOOK, abs=1e-3)


def test_nobody_is_filled_in_for_who_was_not_heard_at_a_steady_pace() -> None:
    robot = Robot().stream((STEADY - 1) * PERIOD).to(1.0)
    assert robot.filled == []
    assert Robot().stream(2.0, 5 * PERIOD).filled == []
    assert Robot(bridges(bridge=0.0)).stream(1.0).to(2.0).filled == []


def test_whose_connection_has_ended_is_not_filled_in_for_once_its_node_is_gone() -> None:
    robot = Robot().stream(1.0)
    robot.stands = False
    assert robot.gone(1.0 + 2 * BRIDGE).to(2.0).filled == []


def test_a_connection_that_has_ended_begins_no_bridge_and_soon_ends_one() -> None:
    robot = Robot().stream(1.0)
    robot.stands = False
    assert robot.to(2.0).filled == []
    robot.stands = True
    robot.stream(3.0).to(3.2)
    assert len(robot.filled) >= 6
    robot.stands = False
    robot.to(5.0)
    assert robot.filled[-1] < 3.2 + 2 * BRIDGE + 2 * PERIOD


@pytest.mark.parametrize("period", [0.001, PERIOD])
def test_at_high_rates_a_connection_that_has_ended_is_bridged_for_a_moment(period: float) -> None:
    """Or where it is much faster than its row says."""
    robot = Robot(bridges(bridge=0.0025, outputs=(signal("/out", period=period),)))
    robot.stream(1.0, 0.001)
    robot.stands = False
    robot.to(2.0)
    last = robot.original[-1]
    assert robot.filled and robot.filled[0] <= last + 0.0025 + LOOK + 1e-4
    assert robot.filled[-1] <= last + 0.0025 + LOOK_AGAIN_S + 2 * LOOK
    again = len(robot.filled)
    robot.stands = True
    robot.stream(3.0, 0.001)
    assert len(robot.filled) == again


def test_a_node_that_is_gone_is_filled_in_for_at_once_until_the_reconfigurator_has_spoken() -> None:
    robot = Robot().stream(1.0)
    robot.stands = False
    robot.gone(1.001)
    assert robot.filled == [1.001]
    last = robot.to(2.0).filled[-1]
    assert 1.001 + LOOK_AGAIN_S - PERIOD <= last <= 1.001 + LOOK_AGAIN_S + 2 * LOOK
    robot = Robot().stream(1.0).gone(1.001).to(1.004)
    told = bridges(publishing=True, bridge=0.0, original="/original")
    robot._note(robot.driver.change(told))
    steps = [b - a for a, b in zip(robot.to(2.0).filled, robot.filled[1:])]
    assert len(steps) > 40 and all(abs(step - PERIOD) < 1e-5 for step in steps)


def test_only_who_was_heard_last_at_a_steady_pace_is_filled_in_for_when_it_is_gone() -> None:
    assert Robot().stream(1.0).gone(1.001, "/another").to(1.015).filled == []
    assert Robot().stream((STEADY - 1) * PERIOD).gone(0.1).to(1.0).filled == []
    assert Robot(bridges(bridge=0.0)).stream(1.0).gone(1.001).to(1.02).filled == []
    robot = Robot().stream(1.0).gone(1.001).speaks(1.01)
    assert robot.filled == [1.001] and robot.to(1.03).filled == [1.001]
    late = Robot().stream(1.0).to(1.2)
    filled = len(late.filled)
    assert len(late.gone(1.2).to(1.2 + PERIOD - 1e-3).filled) <= filled + 1


def test_who_is_gone_while_it_hands_over_consumers_is_not_filled_in_for() -> None:
    robot = Robot(bridges(publishing=True, bridge=0.0, original="/original")).to(1.0).speaks(1.0)
    robot._note(robot.driver.change(bridges(original="/original")))
    robot.stream(1.2)
    count = len(robot.filled)
    assert len(robot.gone(1.2).filled) == count


def test_what_was_heard_while_it_looked_counts() -> None:
    robot = Robot(look=0.004).stream(1.0)
    late = robot.original[-1] + LATE * PERIOD + 0.002
    robot.speaks(late).to(late + LATE * PERIOD - 1e-4)
    assert robot.filled == []


def test_time_in_which_it_was_not_scheduled_is_no_silence_of_others() -> None:
    robot = Robot().stream(1.0)
    robot.driver.time = 1.5
    robot.driver.tell(events.Tick)
    robot._input = 1.5
    robot.to(1.5 + BRIDGE - 2 * PERIOD)
    assert robot.filled == []
    robot.to(2.0)
    assert robot.filled


def test_without_fresh_inputs_it_publishes_nothing_and_not_what_another_bridge_says() -> None:
    robot = Robot(bridges(inputs=(signal("/in", deadline=PERIOD * 1.5),)))
    robot.stream(0.96)
    robot.source = ""
    robot.stream(1.0)
    assert robot.to(2.0).filled == []
    robot = Robot().stream(1.0)
    robot.to(1.1)
    assert robot.filled
    robot.source = "/substitute_of_the_input"
    count = len(robot.filled)
    assert len(robot.to(2.0).filled) <= count + 1


def test_an_integral_is_not_bridged() -> None:
    robot = Robot(bridges(code=INTEGRAL))
    assert robot.stream(1.0).to(2.0).filled == []


def test_the_takeover_at_the_deadline_is_seamless() -> None:
    robot = Robot().stream(1.0).to(1.245)
    told = bridges(publishing=True, bridge=0.0, original="/original")
    robot._note(robot.driver.change(told))
    robot.to(2.0)
    steps = [b - a for a, b in zip(robot.filled, robot.filled[1:])]
    assert all(abs(step - PERIOD) < 1e-5 for step in steps)


@pytest.mark.parametrize("told", [bridges(bridge=0.0), row(outputs=(signal("/more"),)), idle()])
def test_a_row_that_says_otherwise_ends_it(told: Substitution) -> None:
    robot = Robot().stream(1.0).to(1.2)
    robot.driver.change(told)
    count = len(robot.filled)
    assert len(robot.to(2.0).filled) == count


def test_a_row_that_is_gone_ends_it() -> None:
    robot = Robot().stream(1.0).to(1.2)
    robot.driver.tell(events.RowRemoved)
    count = len(robot.filled)
    assert len(robot.to(2.0).filled) == count


def test_one_that_returned_and_hangs_again_is_filled_in_for_as_before() -> None:
    robot = Robot().stream(1.0).to(1.2)
    taken = bridges(publishing=True, bridge=0.0, original="/original")
    robot._note(robot.driver.change(taken))
    robot.to(2.0).speaks(2.0)
    robot._note(robot.driver.change(bridges(original="/original")))  # it is on probation
    robot.driver.time = 2.01
    robot.stream(2.01 + 60 * PERIOD)
    robot._note(robot.driver.change(bridges()))  # all is well
    last = robot.original[-1]
    robot.to(last + 0.1)
    after = [time for time in robot.filled if time > last]
    assert after and after[0] <= last + BRIDGE + LOOK + 1e-4


def test_one_that_comes_and_goes_is_filled_in_for_each_time() -> None:
    robot = Robot(replace(bridges(), provider="/original")).stream(1.0).to(1.2)
    for _ in range(3):
        robot._note(robot.driver.change(bridges(publishing=True, bridge=0.0)))
        robot.to(robot.driver.time + CHANGEOVER_S)
        robot._note(robot.driver.change(replace(bridges(), provider="/original")))
        robot.stream(round(robot.driver.time + (STEADY - 1) * PERIOD, 9))
        last = robot.original[-1]
        robot.to(last + 0.1)
        after = [time for time in robot.filled if time > last]
        assert after and after[0] <= last + BRIDGE + LOOK + 1e-4


def test_while_consumers_are_handed_over_to_a_returning_original_nobody_is_filled_in_for() -> None:
    robot = Robot(bridges(publishing=True, bridge=0.0, original="/original")).to(1.0).speaks(1.0)
    robot._note(robot.driver.change(bridges(original="/original")))
    robot.stream(1.2).to(1.5)
    assert robot.looks == []
    robot.to(1.0 + CHANGEOVER_S + 0.1)
    assert robot.filled


@pytest.mark.parametrize("cut_off", [False, True])
@pytest.mark.parametrize("on_partition", OnPartition)
def test_a_stranger_is_not_filled_in_for_and_stands_in_nobodys_way(
    on_partition: OnPartition, cut_off: bool
) -> None:
    told = replace(bridges(), provider="/original", on_partition=on_partition)
    robot = Robot(told).stream(1.0)
    robot.driver.tell(events.ReachChanged, cut_off)
    robot.stranger_speaks(1.001)
    assert robot.gone(1.002, "/stranger").to(1.01).filled == []
    robot.stranger_speaks(1.03).stranger_speaks(1.04).to(1.2)
    assert 0 < len(robot.filled) and robot.filled[0] <= 1.0 + BRIDGE + LOOK


def test_another_provider_is_not_late_before_it_was_heard() -> None:
    robot = Robot(replace(bridges(), provider="/original")).stream(1.0)
    robot.driver.change(replace(bridges(), provider="/another"))
    assert robot.to(1.3).filled == []


def test_a_spare_one_that_carries_on_is_filled_in_for_once_it_is_heard() -> None:
    """It was a stranger until then: its pace is learned anew."""
    robot = Robot(replace(bridges(), provider="/original")).stream(1.0)
    robot.driver.change(bridges())
    for turn in range(STEADY + 2):
        robot.stranger_speaks(round(1.0 + turn * PERIOD, 9))
    last = robot.driver.time
    assert robot.filled == [] and robot.gone(last, "/original").filled == []
    robot.to(last + 0.2)
    assert robot.filled and robot.filled[0] <= last + BRIDGE + LOOK + 1e-4


def test_it_starts_from_what_the_original_said_last() -> None:
    robot = Robot().stream(1.0)
    robot.source = ""
    old = (("data", 1.0),), 5, 10**9  # a value that is older than the original's last message
    robot._note(robot.driver.tell(events.InputArrived, "/in", "/sensor", *old))
    robot.to(1.2)
    composed = [each for _, each in robot.driver.said if isinstance(each, events.Compose)]
    assert composed[-1].overheard and not composed[0].overheard
    stamps = [each.stamp for _, each in robot.driver.said if isinstance(each, events.Publish)]
    assert set(stamps) == {7}
    robot.driver.change(bridges(publishing=True, bridge=0.0))
    composed = [each for _, each in robot.driver.said if isinstance(each, events.Compose)]
    assert not composed[-1].overheard


def test_what_others_say_elsewhere_is_not_the_original() -> None:
    robot = Robot().stream(1.0)
    for turn in range(20):
        robot.speaks(1.0 + turn * PERIOD, topic="/elsewhere")
    assert robot.filled


@settings(max_examples=many(150), deadline=None, derandomize=True)
@given(
    st.lists(
        st.one_of(
            st.floats(0.5, 1.5),  # jitter
            st.floats(2.0, 3.1),  # late, about when it is filled in
            st.sampled_from((2.0, 2.5, 5.0, 12.0)),  # half rate, intermittent, hung, awake again
        ),
        min_size=1,
        max_size=40,
    ),
    st.sampled_from((0.0001, LOOK, 0.003)),
)
def test_whatever_the_original_does_each_is_heard_once_a_period_at_the_edges(
    gaps: List[float], look: float
) -> None:
    robot = Robot(look=look).stream(SETTLED)
    for gap in gaps:
        robot.speaks(round(robot.original[-1] + gap * PERIOD, 6))
    heard = robot.to(robot.original[-1] + 20 * PERIOD).heard
    for (at, who), (then, next_) in zip(heard, heard[1:]):
        if (who, next_) == ("original", "substitute"):
            assert then - at >= LATE * PERIOD - 1e-6, "it filled in for one that was not late"
        if (who, next_) == ("substitute", "substitute"):
            assert abs(then - at - PERIOD) < 0.5 * PERIOD + 1e-6, "not at its period"
        if at > SETTLED:
            assert then - at <= BRIDGE + look + 2e-3, "a gap that was not filled in"


def test_without_a_healer_it_goes_on_until_one_is_there_for_long() -> None:
    robot = Robot().stream(1.0)
    robot.stands, robot.alone = False, True
    robot.gone(1.005).to(3.0)
    robot.alone = False
    robot.to(3.0 + ALONE_LOOKS * LOOK_AGAIN_S / 2.0)
    steps = [b - a for a, b in zip(robot.filled, robot.filled[1:])]
    assert max(steps) < 1.1 * PERIOD and robot.filled[-1] > robot.driver.time - 2 * PERIOD
    robot.to(3.0 + 2.0 * ALONE_LOOKS * LOOK_AGAIN_S)
    assert robot.filled[-1] < 3.5 + ALONE_LOOKS * LOOK_AGAIN_S

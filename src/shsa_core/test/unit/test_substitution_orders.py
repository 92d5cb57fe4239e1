"""In whatever order things come: the stamps of what a substitute publishes, and its values."""
from dataclasses import replace
from typing import Any, Dict, List, Tuple

from hypothesis import example, given, settings, strategies as st
from substitute_driver import DEADLINE, PERIOD, check, row, signal

from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import Substitution
from shsa_core.substitution import events
from shsa_core.substitution.machine import Substitute
from shsa_testing.thorough import many

START = 1_700_000_000_000_000_000
ORIGINAL = "/original"
SLOW = 0.1
INPUTS = (signal("/a"), signal("/slow", SLOW, 5 * SLOW), signal("/held", None, None))
CODE = "t0=x[0]; t1=x[1]; t2=x[2];\ndef _tf1(i1,i2,i3): return i1+i2+i3\nt3=_tf1(t0,t1,t2);\ny=t3"
HOT = replace(
    row(inputs=INPUTS, code=CODE, original=ORIGINAL),
    provider=ORIGINAL,
    bridge=2.5 * PERIOD,
    on_partition=OnPartition.HEAL,
)
HERE = replace(HOT, on_partition=OnPartition.WAIT)
Step = Tuple[str, Any]


def at(time: float) -> int:
    """ROS time at a time of the story, in ns."""
    return START + int(round(time * 1e9))


class Story:
    """A substitute beside a model of what its consumers have heard.

    `seldom`: while it does not hurry it is told of inputs as its shell does, the newest of each.
    """

    def __init__(self, told: Substitution, seldom: bool) -> None:
        self.core, self.time, self.seldom = Substitute(), 10.0, seldom
        self.kept: Dict[str, Tuple[float, events.InputArrived]] = {}
        self.newest: Dict[str, int] = {}  # the stamp of each input
        self.original = 0  # the stamp of its newest message
        self.floor = 0  # the newest stamp that consumers have heard
        self.published: List[events.Publish] = []
        self.looks: List[events.LookAtOthers] = []
        self.told = told
        self.row(told)
        self.hear(events.Advertised(self.time, "/out"))
        for each in INPUTS:
            self.arrive(each.topic, 0.0)

    def row(self, told: Substitution) -> None:
        """The row changes; the last good message is the newest that consumers have heard."""
        self.told = told
        last = events.LastMessage((), self.floor) if told.last_message else None
        self.hear(events.RowChanged(self.time, told, (), last, at(self.time)))

    def hear(self, event: events.Event) -> None:
        """Hand over an event, and what was kept before it if that is due."""
        if not isinstance(event, events.OtherHeard) or event.time >= self.core.reads_at:
            for since, kept in sorted(self.kept.values(), key=lambda each: each[1].time):
                self.handle(replace(kept, waited=kept.time - since))
            self.kept = {}
        self.handle(event)

    def handle(self, event: events.Event) -> None:
        """Hand over an event, and check what it has published."""
        commands = self.core.handle(event)
        check(self.core, commands)
        for command in commands:
            if isinstance(command, events.Publish):
                timed = [self.newest[each.topic] for each in INPUTS if each.deadline]
                assert command.stamp == max(self.floor, min(timed)), "stands still, or goes back"
                self.floor = command.stamp
                self.published.append(command)
            if isinstance(command, events.LookAtOthers):
                self.looks.append(command)

    def arrive(self, topic: str, age: float) -> None:
        """An input comes; its stamps never go back."""
        stamp = self.newest[topic] = max(at(self.time - age), self.newest.get(topic, 0))
        values = (("data", self.time),)
        event = events.InputArrived(self.time, topic, "/sensor", values, stamp, at(self.time))
        if self.seldom and not self.core.hurries and self.time < self.core.reads_at:
            since = self.kept[topic][0] if topic in self.kept else self.time
            self.kept[topic] = since, event
        else:
            self.hear(event)

    def other(self, age: float) -> None:
        """The original publishes; its stamps never go back."""
        self.original = max(at(self.time - age), self.original)
        self.hear(events.OtherHeard(self.time, "/out", ORIGINAL, self.original))
        self.floor = max(self.floor, self.original)

    def pass_to(self, time: float) -> None:
        """Let time pass, with every tick that is wanted, and every answer."""
        while True:
            while self.looks:
                self.hear(events.OthersStand(self.time, self.looks.pop(), True))
            due = self.core.next_deadline
            if due > time:
                break
            self.time = due
            self.hear(events.Tick(self.time))
        self.time = time

    def stream(self, turns: int, age: float, speaks: bool) -> None:
        """Inputs come at their periods, and the original at its own if it `speaks`."""
        for turn in range(turns):
            self.arrive("/a", age)
            if turn % int(SLOW / PERIOD) == 0:
                self.arrive("/slow", age)
            if speaks:
                self.other(age / 2)
            self.pass_to(round(self.time + PERIOD, 9))

    def play(self, steps: List[Step]) -> "Story":
        """Play a story."""
        for kind, what in steps:
            if kind == "stream":
                self.stream(what[0], what[1], not self.told.publishing)
            elif kind == "silence":
                self.stream(what[0], what[1], False)
            elif kind == "gone":
                self.hear(events.OtherGone(self.time, "/out", ORIGINAL))
            elif kind == "cut":
                self.hear(events.ReachChanged(self.time, what))
            elif kind == "pause":
                self.pass_to(round(self.time + what, 9))
            elif kind == "held":
                self.arrive("/held", what)
            else:
                message = b"%d" % len(self.published) if what else b""
                self.row(replace(self.told, publishing=what, last_message=message))
        return self


AGES = st.sampled_from((0.0, 0.004, 0.03, 0.2))
TURNS = st.sampled_from((1, 3, 8, 20))
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("stream"), st.tuples(TURNS, AGES)),
        st.tuples(st.just("silence"), st.tuples(TURNS, AGES)),
        st.tuples(st.just("gone"), st.none()),
        st.tuples(st.just("cut"), st.booleans()),
        st.tuples(st.just("pause"), st.sampled_from((0.001, 0.013, DEADLINE / 2, 2 * DEADLINE))),
        st.tuples(st.just("held"), AGES),
        st.tuples(st.just("row"), st.booleans()),
    ),
    min_size=1,
    max_size=12,
)


@settings(max_examples=many(200), deadline=None, derandomize=True)
@given(STEPS, st.sampled_from((HOT, HERE)), st.booleans())
@example([("stream", (20, 0.0)), ("cut", True), ("silence", (20, 0.2))], HOT, False)
@example([("stream", (20, 0.0)), ("silence", (3, 0.0))], HERE, True)
def test_stamps_go_with_the_oldest_input_and_never_back(
    steps: List[Step], told: Substitution, seldom: bool
) -> None:
    Story(told, seldom).play(steps)


@settings(max_examples=many(200), deadline=None, derandomize=True)
@given(STEPS, st.sampled_from((HOT, HERE)))
def test_who_is_told_the_newest_now_and_then_publishes_the_same(
    steps: List[Step], told: Substitution
) -> None:
    told_all, told_newest = (Story(told, seldom).play(steps).published for seldom in (False, True))
    assert told_all == told_newest

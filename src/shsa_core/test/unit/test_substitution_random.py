"""Any story of a substitute: what its consumers see, and its own invariants."""
import math
from dataclasses import replace
from typing import Any, Dict, List, Optional, Set, Tuple

from hypothesis import settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from substitute_driver import CODE, DEADLINE, NAME, check, signal

from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import CHANGEOVER_S, Substitution
from shsa_core.substitution import events
from shsa_core.substitution.machine import Substitute
from shsa_testing.thorough import many

INPUTS = (signal("/in"), signal("/spare", deadline=None), signal("/in", node="/left"))
OUTPUTS = tuple(
    signal(topic, period=period) for topic in ("/out", "/other") for period in (0.02, 0.5, None)
)
CODES = (
    CODE,
    "t0=x[0];\ndef _tf1(i1): return derivative(i1)\nt1=_tf1(t0);\ny=t1",
    "t0=x[0];\ndef _tf1(i1): return 1.0/i1\nt1=_tf1(t0);\ny=t1",
    "t0=x[0];\ndef _tf1(i1): return integral(i1)\nt1=_tf1(t0);\ny=t1",
    "nonsense",
)
CONSUMERS = ("/one", "/two")
NODES = ("", "/left", "/node")


class AnySubstitute(RuleBasedStateMachine):
    """A model of what it was told, beside the core."""

    @initialize()
    def start(self) -> None:
        self.core = Substitute()
        self.now = 100.0
        self.stamps: Dict[str, int] = {}
        self.told = Substitution(NAME, "", (), "", ())
        self.muted_at: Optional[float] = None
        self.original = ""
        self.advertised: Dict[str, bool] = {}
        self.listening: Set[Tuple[str, str, str]] = set()
        self.looks: List[events.LookAtOriginal] = []
        self.last: Optional[float] = None  # message to all since the row changed
        self.stale_looks = 0  # which the core awaits no more
        self.cut = False
        self.others: Optional[events.LookAtOthers] = None
        self.spoke, self.went = float("-inf"), False
        self.heard_at: Optional[float] = None  # another one, to whom it must have yielded
        self.hear(events.RowChanged(self.now, self.told))

    def hear(self, event: events.Event) -> None:
        """Hand over an event, and check every command against the model."""
        commands = self.core.handle(event)
        for command in commands:
            look = getattr(self, "on_" + type(command).__name__, None)
            if look is not None:
                look(command)
        check(self.core, commands)

    def on_Listen(self, command: events.Listen) -> None:
        key = command.signal.topic, command.signal.field, command.signal.node
        assert key not in self.listening, "it listens twice"
        self.listening.add(key)

    def on_Advertise(self, command: events.Advertise) -> None:
        assert command.topic not in self.advertised, "it advertises twice"
        self.advertised[command.topic] = False

    def on_Withdraw(self, command: events.Withdraw) -> None:
        del self.advertised[command.topic]

    def on_LookAtOriginal(self, look: events.LookAtOriginal) -> None:
        self.looks.append(look)
        assert look.original and len(self.looks) <= 1 + self.stale_looks

    def on_Publish(self, command: events.Publish) -> None:
        topic = command.outputs[0].topic
        assert self.advertised[topic]
        yields = self.muted_at is not None and self.now < self.muted_at + CHANGEOVER_S
        alone = self.cut and self.told.on_partition is OnPartition.HEAL
        assert self.told.publishing or (yields and self.original) or alone or self.bridges()
        assert topic in self.told.topics or not self.told.publishing
        silent = self.heard_at is None or self.now - self.heard_at >= DEADLINE - 1e-6
        assert silent or self.bridges()
        if command.only:
            assert self.told.publishing or alone or self.bridges()
            assert command.only not in command.served
            return
        assert self.stamps.get(topic, 0) <= command.stamp <= self.ros_time()
        self.stamps[topic] = command.stamp
        period = command.outputs[0].period
        if period is not None and self.last is not None:
            assert self.now - self.last > 0.49 * period, "two messages at once"
        self.last = self.now

    def on_LookAtOthers(self, look: events.LookAtOthers) -> None:
        assert self.told.bridge and not self.told.publishing and look.topic in self.told.topics
        self.others = look

    def bridges(self) -> bool:
        """Tell if it may fill in: nobody else was heard for long enough."""
        told = self.told
        return told.bridge > 0.0 and (self.went or self.now - self.spoke >= told.bridge - 1e-6)

    @rule(
        publishing=st.booleans(),
        source=st.sampled_from(INPUTS),
        output=st.sampled_from(OUTPUTS),
        code=st.sampled_from(CODES),
        original=st.sampled_from(NODES),
        message=st.sampled_from((b"", b"one", b"two")),
        alone=st.sampled_from(OnPartition),
        yields=st.booleans(),
        provider=st.sampled_from(NODES),
        bridge=st.sampled_from((0.0, 0.05)),
    )
    def program(
        self,
        publishing: bool,
        source: Any,
        output: Any,
        code: str,
        original: str,
        message: bytes,
        alone: OnPartition,
        yields: bool,
        provider: str,
        bridge: float,
    ) -> None:
        row = Substitution(NAME, "s", (source,), code, (output,), (), 1.0, publishing, original)
        row = replace(
            row, last_message=message, on_partition=alone, yields=yields, provider=provider
        )
        self.change(replace(row, bridge=bridge))

    @rule(publishing=st.booleans())
    def order(self, publishing: bool) -> None:
        """The same program, told to publish or muted."""
        self.change(replace(self.told, service="s", quality=1.0, publishing=publishing))

    @rule(outputs=st.sets(st.sampled_from(OUTPUTS)), inputs=st.sets(st.sampled_from(INPUTS)))
    def rest(self, outputs: Any, inputs: Any) -> None:
        self.change(Substitution(NAME, "", tuple(inputs), "", tuple(outputs)))

    def change(self, row: Substitution) -> None:
        """Keep who was told what: who publishes, and until when it may yield."""
        if self.told.publishing and not row.publishing:
            self.muted_at = self.now
        if row.publishing:
            self.muted_at = None
        if row.publishing is not self.told.publishing or row.topics != self.told.topics:
            self.heard_at = None
        self.told, self.original = row, row.original
        self.stale_looks, self.last = len(self.looks), None
        last = None
        if row.last_message and row.outputs:
            values = tuple((signal.field, 7.0) for signal in row.outputs)
            last = events.LastMessage(values, self.ros_time(-0.01))
        self.hear(events.RowChanged(self.now, row, (), last, self.ros_time()))

    def ros_time(self, later: float = 0.0) -> int:
        """ROS time in ns, now or a while later."""
        return 10**18 + int(round((self.now + later) * 1e9))

    @rule(
        topic=st.sampled_from(("/in", "/spare")),
        node=st.sampled_from(NODES),
        value=st.sampled_from((0.0, 1.0, 5.0, float("nan"))),
        age=st.sampled_from((0.0, 0.001, 0.5, -1.0)),
    )
    def arrive(self, topic: str, node: str, value: float, age: float) -> None:
        stamp, now = self.ros_time(-age), self.ros_time()
        self.hear(events.InputArrived(self.now, topic, node, (("data", value),), stamp, now))

    @rule(late=st.sampled_from((0.0, 0.0, 0.001, 0.03)))
    def deadline(self, late: float) -> None:
        """The next thing that is due."""
        due = self.core.next_deadline
        if due < math.inf:
            assert due > self.now
            self.now = due + late
            self.hear(events.Tick(self.now))

    @rule(passed=st.sampled_from((0.0, 0.001, 0.01, 0.1, 0.3, 2.0)))
    def wait(self, passed: float) -> None:
        self.now += passed
        self.hear(events.Tick(self.now))

    @rule()
    def registered(self) -> None:
        for topic in list(self.advertised):
            self.advertised[topic] = True
            self.hear(events.Advertised(self.now, topic))

    @rule(topic=st.sampled_from(("/out", "/other")), consumer=st.sampled_from(CONSUMERS))
    def join(self, topic: str, consumer: str) -> None:
        if self.advertised.get(topic):
            self.hear(events.ConsumerJoined(self.now, topic, consumer))

    @rule(served=st.sets(st.sampled_from(CONSUMERS)), up=st.booleans())
    def answer(self, served: Any, up: bool) -> None:
        if self.looks:
            look = self.looks.pop(0)
            self.stale_looks = max(0, self.stale_looks - 1)
            self.hear(
                events.OriginalServes(self.now, look, frozenset(served) if up or served else None)
            )

    @rule(topic=st.sampled_from(("/out", "/other")))
    def other(self, topic: str) -> None:
        """Somebody else publishes."""
        self.speak(topic)

    def speak(self, topic: str) -> None:
        """Somebody else publishes."""
        told = self.told
        yields = told.yields and told.provider in ("", "/node")
        rival = yields or (self.cut and told.on_partition is OnPartition.HEAL)
        if rival and topic == self.core._others.topic and topic in told.topics:
            self.heard_at = self.now
        self.spoke, self.went, self.last = self.now, False, None
        self.hear(events.OtherHeard(self.now, topic, "/node"))

    @rule(
        gaps=st.lists(st.sampled_from((0.01, 0.02, 0.04)), min_size=6, max_size=8),
        quiet=st.sampled_from((0.03, 0.06, 0.2)),
        stands=st.booleans(),
        dies=st.booleans(),
    )
    def original_stream(self, gaps: List[float], quiet: float, stands: bool, dies: bool) -> None:
        """The original publishes for a while, and is silent then."""
        topic = self.told.topics[0] if self.told.topics else "/out"
        for gap in gaps:
            self.now += gap
            self.speak(topic)
        if dies:
            self.now += 0.005
            self.leave(topic)
        self.now += quiet
        self.hear(events.Tick(self.now))
        self.answer_look(stands)

    @rule(stands=st.booleans())
    def looked(self, stands: bool) -> None:
        self.answer_look(stands)

    def answer_look(self, stands: bool) -> None:
        """The answer to a look at the others."""
        if self.others is not None:
            look, self.others = self.others, None
            self.last = None
            self.hear(events.OthersStand(self.now, look, stands))

    @rule(topic=st.sampled_from(("/out", "/other")), node=st.sampled_from(("/node", "/another")))
    def gone(self, topic: str, node: str) -> None:
        """The node of somebody else is gone."""
        self.leave(topic, node)

    def leave(self, topic: str, node: str = "/node") -> None:
        """The node of somebody else is gone."""
        self.went = self.went or (topic, node) == (self.core._others.topic, "/node")
        self.last = None
        self.hear(events.OtherGone(self.now, topic, node))

    @rule(cut=st.booleans())
    def reach(self, cut: bool) -> None:
        self.cut, self.last = cut, None
        self.hear(events.ReachChanged(self.now, cut))

    @rule()
    def lost(self) -> None:
        self.hear(events.RowRemoved(self.now))


TestAnySubstitute = AnySubstitute.TestCase
TestAnySubstitute.settings = settings(
    max_examples=many(100), stateful_step_count=60, deadline=None, derandomize=True
)

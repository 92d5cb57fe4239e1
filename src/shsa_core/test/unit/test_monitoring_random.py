"""Any story of watched topics: what must hold for the table of health, and the core's own
invariants after every event.
"""
from typing import Any, Dict, Optional, Tuple

import hypothesis
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from monitor_bench import DEADLINE, PERIOD, Bench, message_checks, provision, row, service, table

from shsa_core.model.checks import UnknownPublisher
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.service import AdaptiveDeadline
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring import events, settings
from shsa_testing.failures import failures_in
from shsa_testing.thorough import many

INTRUDERS = message_checks(UnknownPublisher(0.1))
SERVICES = (
    service(name="one", topic="/a", node="/n"),
    service(name="one", topic="/a", node="/m", period=5 * PERIOD),
    service(name="one", topic="/a", node="/n", period=None),
    service(name="two", topic="/a", node="/o", checks=INTRUDERS),
    service(name="two", topic="/b", node="/o", provides=(provision(range=None),)),
    service(name="two", topic="/a", node="/n", deadline=AdaptiveDeadline(100.0)),
    service(name="three", topic="/b", node="/n", period=None, needed=True),
)
TOPICS = ("/a", "/b", "/unwatched")
NODES = ("/m", "/n", "/o", "/substitute_1", "/substitute_2")


class AnyRobot(RuleBasedStateMachine):
    """An observer beside the monitor, of what it was told and what it said."""

    @initialize()
    def start(self) -> None:
        self.learns_after, settings.LEARN_GAPS = settings.LEARN_GAPS, 5
        self.bench = Bench(SERVICES[0], SERVICES[4])
        self.connected: Dict[Tuple[str, str], bool] = {}
        self.rows: Dict[str, Substitution] = {}
        self.som = Som((SERVICES[0], SERVICES[4]))
        self.ended = False

    def teardown(self) -> None:
        settings.LEARN_GAPS = self.learns_after

    def hear(self, event: events.Event) -> None:
        """Hand over an event, and check what is said against what was told."""
        before = dict(self.bench.rows)
        commands = self.bench.send(event)
        assert not (self.ended and commands), "the launch ends, and something is told"
        failures = failures_in(commands)
        for failure in failures:
            self.check_failure(failure, before, event)
        changes = [each for each in commands if isinstance(each, events.HealthChanged)]
        refused = [each for each in commands if isinstance(each, events.ChangeRefused)]
        assert commands[: len(changes)] == changes and len(changes) <= 1
        for refusal in refused:
            self.check_refusal(refusal)
        for change in changes:
            assert not {each.key for each in change.rows} & set(change.removed)
        due = self.bench.core.next_deadline
        assert not isinstance(event, events.Tick) or due > self.bench.now, "a tick did nothing"
        if self.ended:
            return
        for topic in self.som.topics():
            assert any(key[0] == topic for key in self.bench.rows), "nobody is told of a topic"
        for health in table(self.bench.core):
            assert self.som.of_topic(health.topic), "a topic that nobody watches"
            self.check_row(health)

    def check_failure(
        self,
        failure: PublisherHealth,
        before: Dict[Tuple[str, str], PublisherHealth],
        event: events.Event,
    ) -> None:
        """Check that who fails had not failed before, and was not told to be silent.

        Each service that was never there is told of for itself, and so are wrong values of who was
        silent before.
        """
        key = failure.topic, failure.publisher
        known = before.get(key)
        again = known is not None and known.state is PublisherState.FAILED
        spoke = known is not None and str(known.kind) in ("silent", "never_published")
        anew = str(failure.kind) == "never_published" or (spoke and failure.kind != "silent")
        assert not again or anew, "told twice"
        assert failure.since == event.time
        told = self.rows.get(failure.publisher)
        muted = told is not None and not (told.publishing and failure.topic in told.topics)
        quiet = ("silent", "node_gone", "never_published")
        assert not (muted and str(failure.kind) in quiet), "a muted substitute is silent"
        after = self.bench.rows.get(key)
        assert after is None or after.kind is failure.kind or isinstance(event, events.Disconnected)

    def check_refusal(self, refusal: events.ChangeRefused) -> None:
        """Only what a healthy publisher contradicts is refused."""
        asked = self.som.services[refusal.service.name]
        assert asked != refusal.service, "nothing is refused"
        rows = [row for row in table(self.bench.core) if row.topic == asked.topic]
        assert any(row.state is PublisherState.HEALTHY for row in rows), "nobody contradicts"

    def check_row(self, health: PublisherHealth) -> None:
        healthy = health.state is PublisherState.HEALTHY
        assert not healthy or self.connected.get(health.key), "healthy, and not there"
        assert health.since <= self.bench.now
        assert (health.kind is None) == (health.state is not PublisherState.FAILED)
        service_ = self.bench.core.service_of(*health.key)
        if healthy and service_ is not None and service_.period is not None:
            assert health.first_message is not None, "healthy without a message"

    @rule(topic=st.sampled_from(TOPICS), node=st.sampled_from(NODES))
    def connect(self, topic: str, node: str) -> None:
        self.connected[topic, node] = True
        self.hear(events.Connected(self.bench.now, topic, node))

    @rule(topic=st.sampled_from(TOPICS), node=st.sampled_from(NODES))
    def disconnect(self, topic: str, node: str) -> None:
        self.connected[topic, node] = False
        self.hear(events.Disconnected(self.bench.now, topic, node))

    @rule(topic=st.sampled_from(TOPICS), node=st.sampled_from(NODES))
    def interrupt(self, topic: str, node: str) -> None:
        self.hear(events.Interrupted(self.bench.now, topic, node))

    @rule(
        topic=st.sampled_from(TOPICS),
        node=st.sampled_from(NODES),
        value=st.sampled_from((1.0, 1.0, 1000.0, float("nan"), None)),
        count=st.sampled_from((1, 3, 6)),
    )
    def stream(self, topic: str, node: str, value: Optional[float], count: int) -> None:
        """Some messages in order, and the ticks between them."""
        values = None if value is None else (value,)
        for _ in range(count):
            self.let_pass(PERIOD)
            found = self.bench.core._board.find(topic, node)
            if found is None:
                self.connected[topic, node] = True  # its message is the first sign of it
            self.hear(events.Message(self.bench.now, topic, node, values))

    @rule(
        node=st.sampled_from(NODES[3:]), topics=st.sets(st.sampled_from(TOPICS)), to=st.booleans()
    )
    def substitution(self, node: str, topics: Any, to: bool) -> None:
        new = row(node, to, *sorted(topics), service="one" if topics else "")
        self.rows[node] = new
        self.hear(events.SubstitutionsChanged(self.bench.now, (new,)))

    @rule(node=st.sampled_from(NODES[3:]), whole=st.booleans())
    def substitution_ends(self, node: str, whole: bool) -> None:
        self.rows.pop(node, None)
        rest: Tuple[Substitution, ...] = tuple(self.rows.values()) if whole else ()
        removed = () if whole else (node,)
        self.hear(events.SubstitutionsChanged(self.bench.now, rest, removed, whole))

    @rule(
        services=st.sets(st.sampled_from(range(len(SERVICES))), min_size=1),
        unheard=st.sets(st.sampled_from(TOPICS)),
    )
    def another_som(self, services: Any, unheard: Any) -> None:
        chosen = {SERVICES[number].name: SERVICES[number] for number in sorted(services)}
        self.som = Som({(each.topic, each.node): each for each in chosen.values()}.values())
        if not self.ended:
            self.connected = {
                key: there for key, there in self.connected.items() if self.som.of_topic(key[0])
            }
        self.hear(events.SomChanged(self.bench.now, self.som))
        for topic in sorted({*self.som.topics()} - unheard):
            self.hear(events.Subscribed(self.bench.now, topic))

    @rule(topic=st.sampled_from(TOPICS))
    def subscribed(self, topic: str) -> None:
        self.hear(events.Subscribed(self.bench.now, topic))

    @rule(passed=st.sampled_from((0.0, PERIOD, DEADLINE, 1.0, 20.0)))
    def wait(self, passed: float) -> None:
        self.let_pass(passed)

    @rule(late=st.sampled_from((0.001, DEADLINE, 3.0)))
    def late_tick(self, late: float) -> None:
        """The monitor was not scheduled for a while."""
        self.bench.now += late
        self.hear(events.Tick(self.bench.now, late))

    def let_pass(self, seconds: float) -> None:
        end = self.bench.now + seconds
        while self.bench.core.next_deadline <= end:
            self.bench.now = max(self.bench.now, self.bench.core.next_deadline)
            self.hear(events.Tick(self.bench.now))
        self.bench.now = end

    @rule(sure=st.sampled_from([True] + 20 * [False]))
    def ending(self, sure: bool) -> None:
        if sure:
            self.hear(events.Ending(self.bench.now))
            self.ended = True


TestAnyRobot = AnyRobot.TestCase
TestAnyRobot.settings = hypothesis.settings(
    max_examples=many(100), stateful_step_count=50, deadline=None, derandomize=True
)

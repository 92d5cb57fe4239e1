"""The health of every publisher of every watched topic: events in, failures out."""
from dataclasses import dataclass
from math import inf
from typing import Callable, Dict, List, Optional, Set, Tuple, Type

from shsa_core.monitoring.events import (
    FAILED,
    HEALTHY,
    UNKNOWN,
    Connected,
    Disconnected,
    FailureDetected,
    HealthChanged,
    HealthEvent,
    HealthOutput,
    Key,
    Late,
    Message,
    PublisherHealth,
    SomChanged,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.evidence import Evidence, Finding, TopicChecks
from shsa_core.monitoring.publishers import Publisher, WatchedTopic
from shsa_core.model.checks import NEVER_PUBLISHED, NODE_GONE, SILENT, UNKNOWN_PUBLISHER


@dataclass(frozen=True)
class Settings:
    """The monitor's settings, where a topic has none of its own.

    `startup_grace`: s until a topic on which nothing was ever published has failed.
    `deadline`: periods without a message after which a publisher is silent, but at least `minimum_deadline` s:
    a healthy stream of a 10 ms period has gaps of 53 ms on a loaded machine.
    """

    startup_grace: float = 15.0
    deadline: float = 5.0
    minimum_deadline: float = 0.1


class HealthMonitor:
    """Judges publishers by their messages and connections; pure, see `handle`."""

    def __init__(self, settings: Settings = Settings()) -> None:
        self._settings = settings
        self._topics: Dict[str, WatchedTopic] = {}
        self._substitutes: Dict[Key, bool] = {}
        self._retired: Set[Key] = set()
        self._next = inf
        self._late = Late(-inf, 0.0)
        self._changed = False
        self._failures: List[FailureDetected] = []
        self._handlers: Dict[Type, Callable] = {
            SomChanged: self._som_changed,
            SubstitutionsChanged: self._substitutions_changed,
            Connected: self._connected,
            Disconnected: self._disconnected,
            Message: self._message,
            Late: self._woke_late,
            Tick: self._tick,
        }

    @property
    def next_deadline(self) -> float:
        """When the next Tick is due, in s; inf: none is. Messages only ever move it away."""
        return self._next

    def handle(self, event: HealthEvent) -> List[HealthOutput]:
        """What `event` brings to light: failures first, then the table if a state changed."""
        self._changed = False
        self._failures = []
        self._handlers[type(event)](event)
        outputs: List[HealthOutput] = list(self._failures)
        if self._changed:
            outputs.append(HealthChanged(event.time, self.table()))
        return outputs

    def table(self) -> Tuple[PublisherHealth, ...]:
        """The health of every publisher, as of the last event."""
        return tuple(
            p.row(topic.name) for topic in self._topics.values() for p in topic.publishers.values()
        )

    def messages(self) -> Dict[Key, int]:
        """How many messages came from each publisher so far."""
        return {
            (topic.name, p.name): p.messages
            for topic in self._topics.values()
            for p in topic.publishers.values()
        }

    def mute(self) -> Set[Key]:
        """The publishers that say nothing and need not: substitutes that stand by."""
        return {
            (topic.name, p.name)
            for topic in self._topics.values()
            for p in topic.publishers.values()
            if p.state == UNKNOWN and self._excused(topic, p)
        }

    def _som_changed(self, event: SomChanged) -> None:
        old, self._topics = self._topics, {}
        for name in event.som.topics():
            services = event.som.of_topic(name)
            checks = TopicChecks(services)
            allowed = (checks.deadline or self._settings.deadline) * checks.period
            if checks.deadline is None:
                allowed = max(allowed, self._settings.minimum_deadline)
            node = services[0].node
            if name in old:
                self._topics[name] = old[name]
                old[name].check(node, checks, allowed)
            else:
                self._topics[name] = WatchedTopic(name, node, checks, allowed, event.time)
                self._topics[name].expect(event.time)
        self._changed = True
        self._next = event.time

    def _substitutions_changed(self, event: SubstitutionsChanged) -> None:
        before, self._substitutes = self._substitutes, dict(event.speaking)
        self._retired -= set(self._substitutes)
        for key, spoke in before.items():
            topic = self._topics.get(key[0])
            publisher = topic.publishers.get(key[1]) if topic else None
            if topic is None or publisher is None:
                continue
            if key not in self._substitutes:
                self._retired.add(key)
            elif spoke and not self._substitutes[key] and publisher.state == HEALTHY:
                topic.hush(publisher, event.time)
                self._changed = True

    def _connected(self, event: Connected) -> None:
        topic = self._topics.get(event.topic)
        if topic is None:
            return
        known = topic.publishers.get(event.publisher)
        if known is None or not known.connected:
            self._retired.discard((event.topic, event.publisher))
            topic.meet(event.publisher, event.time)
            self._changed = True

    def _disconnected(self, event: Disconnected) -> None:
        topic = self._topics.get(event.topic)
        publisher = topic.publishers.get(event.publisher) if topic else None
        if topic is None or publisher is None:
            return
        publisher.connected = False
        self._changed = True
        detail = "its connection was lost: the node died or left"
        if publisher.state == FAILED:
            publisher.kind, publisher.detail = NODE_GONE, detail
        elif publisher.state == UNKNOWN or self._excused(topic, publisher):
            del topic.publishers[publisher.name]
        else:
            self._fail(topic, publisher, event.time, NODE_GONE, detail)
        self._retired.discard((event.topic, event.publisher))
        topic.forget_gone()
        if not topic.publishers:
            topic.expect(event.time)

    def _message(self, event: Message) -> None:
        topic = self._topics.get(event.topic)
        if topic is None:
            return
        publisher = topic.publishers.get(event.publisher)
        if publisher is None:
            publisher = topic.meet(event.publisher, event.time)
            self._changed = True
        elif not publisher.connected:
            return
        topic.spoke = True
        previous = publisher.last_message
        publisher.note_message(event.time)
        if previous is None:
            self._next = min(self._next, event.time + topic.allowed)
        good, failure = publisher.evidence.weigh(event, publisher.state == FAILED)
        intrusion = self._intrusion(topic, publisher, event.time)
        if intrusion is not None:
            good, failure = False, intrusion
        if failure is not None and publisher.state != FAILED:
            self._fail(topic, publisher, event.time, failure.kind, failure.detail)
        if not good:
            publisher.good_in_a_row = 0
            return
        publisher.last_good = event.time
        if publisher.state == UNKNOWN:
            self._become_healthy(topic, publisher, event.time)
        elif publisher.state == FAILED:
            steady = previous is not None and event.time - previous <= topic.allowed
            publisher.good_in_a_row = publisher.good_in_a_row + 1 if steady else 1
            if publisher.good_in_a_row >= topic.checks.common.recovery:
                publisher.evidence.clear()
                self._become_healthy(topic, publisher, event.time)

    def _woke_late(self, event: Late) -> None:
        self._late = event

    def _tick(self, event: Tick) -> None:
        if event.time < self._next:
            return
        self._next = inf
        for topic in self._topics.values():
            self._judge_start(topic, event.time)
            for publisher in topic.publishers.values():
                if topic.deadline(publisher) <= event.time:
                    self._judge_silence(topic, publisher, event)
                self._next = min(self._next, topic.deadline(publisher))

    def _judge_start(self, topic: WatchedTopic, time: float) -> None:
        end = topic.began + self._settings.startup_grace
        if topic.spoke or topic.overdue:
            return
        if time < end:
            self._next = min(self._next, end)
            return
        topic.overdue = True
        guilty = [p for p in topic.publishers.values() if not self._excused(topic, p)]
        blamed = min(guilty, key=lambda p: p.name != topic.node, default=None)
        if blamed is None:
            blamed = topic.expect(time)
        grace = self._settings.startup_grace
        self._fail(topic, blamed, time, NEVER_PUBLISHED, f"no message in the first {grace:g} s")

    def _judge_silence(self, topic: WatchedTopic, publisher: Publisher, event: Tick) -> None:
        """Mute a publisher that may be mute, grant time that the monitor itself has lost, or blame."""
        if self._excused(topic, publisher):
            topic.hush(publisher, event.time)
            self._changed = True
            return
        silence = event.time - (publisher.last_message or 0.0)
        share = topic.allowed / 10
        late = self._late.late if self._late.time >= event.time else 0.0
        if late >= share and publisher.granted < topic.allowed:
            publisher.granted = silence + min(late, topic.allowed) - topic.allowed
            return
        detail = f"no message for {silence:.3f} s, {topic.allowed:.3f} s are allowed"
        self._fail(topic, publisher, event.time, SILENT, detail)
        publisher.evidence = Evidence(topic.checks)

    def _excused(self, topic: WatchedTopic, publisher: Publisher) -> bool:
        """Whether silence is no fault: a substitute that is to be mute here, or that is being stopped."""
        key = (topic.name, publisher.name)
        if key in self._retired:
            return True
        # An idle one, or one that speaks elsewhere, may have advertised this topic as well.
        substitute = any(node == publisher.name for _, node in self._substitutes)
        return substitute and not self._substitutes.get(key, False)

    def _intrusion(
        self, topic: WatchedTopic, publisher: Publisher, time: float
    ) -> Optional[Finding]:
        """What speaks against a publisher that nobody knows, beside one that is known and healthy."""
        patience = topic.checks.common.unknown_publisher
        if publisher.name == topic.node or patience is None or self._known(topic, publisher):
            return None
        if publisher.kind == UNKNOWN_PUBLISHER:
            return Finding(publisher.kind, publisher.detail)
        rightful = [p.name for p in topic.healthy() if self._known(topic, p)]
        if not rightful:
            publisher.intruding_since = None
            return None
        if publisher.intruding_since is None:
            publisher.intruding_since = time
        if time - publisher.intruding_since <= patience:
            return None
        seen = f"it publishes beside {', '.join(rightful)} for {patience:g} s"
        return Finding(UNKNOWN_PUBLISHER, f"{seen}, neither the SOM nor a substitution names it")

    def _known(self, topic: WatchedTopic, publisher: Publisher) -> bool:
        key = (topic.name, publisher.name)
        return publisher.name == topic.node or key in self._substitutes or key in self._retired

    def _fail(
        self, topic: WatchedTopic, publisher: Publisher, time: float, kind: str, detail: str
    ) -> None:
        publisher.become(time, FAILED, kind, detail)
        self._failures.append(
            FailureDetected(time, topic.name, publisher.name, kind, detail, publisher.last_good)
        )
        self._changed = True

    def _become_healthy(self, topic: WatchedTopic, publisher: Publisher, time: float) -> None:
        publisher.become(time, HEALTHY)
        self._next = min(self._next, time + topic.allowed)
        self._changed = True
        topic.forget_gone()

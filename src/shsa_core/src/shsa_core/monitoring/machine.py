"""The monitor's core: judges each publisher of a service by its messages and connections."""
from math import inf
from typing import Dict, List, Optional, Set, Tuple

from shsa_core import dispatch
from shsa_core.model.checks import Checks, IntruderSample
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.board import FAILED, HEALTHY, UNKNOWN, Board, Due, Grace, Silence
from shsa_core.monitoring.events import (
    Command,
    Connected,
    Disconnected,
    Ending,
    Event,
    Key,
    Message,
    PublisherHealth,
    SomChanged,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.evidence import Finding, judge
from shsa_core.monitoring.publishers import NOBODY, Publisher, WatchedTopic
from shsa_core.monitoring.settings import Settings
from shsa_core.monitoring.substitutes import publishes, topics_of


class Monitor:
    """Events in, failures and changes of the table of health out; pure, see `handle`."""

    def __init__(self, settings: Settings = Settings()) -> None:
        self._settings = settings
        self._som = Som()
        self._board = Board()
        self._now = Tick(-inf)
        self._ends = False
        self._handlers: dispatch.Table[None] = dispatch.table(
            Event,
            {
                SomChanged: self._som_changed,
                SubstitutionsChanged: self._substitutions_changed,
                Connected: self._connected,
                Disconnected: self._disconnected,
                Message: self._message,
                Tick: self._tick,
                Ending: self._ending,
            },
        )
        self._judges: dispatch.Table[None] = dispatch.table(
            Due, {Silence: self._judge_silence, Grace: self._judge_start}
        )

    @property
    def next_deadline(self) -> float:
        """When the next Tick is due, in s; inf: none is. Messages only ever move it away."""
        due = None if self._ends else self._board.agenda.next()
        return inf if due is None else due

    def handle(self, event: Event) -> List[Command]:
        """What `event` brings to light: failures first, then the rows that changed."""
        if self._ends:
            return []
        self._handlers[type(event)](event)
        return self._board.commands(event.time)

    def table(self) -> Tuple[PublisherHealth, ...]:
        """The health of every publisher, as of the last event."""
        return self._board.table()

    def messages(self) -> Dict[Key, int]:
        """How many messages came from each publisher so far."""
        return {(topic.name, p.name): p.messages for topic, p in self._board.all()}

    def muted(self) -> Set[Key]:
        """The publishers that publish nothing and need not: substitutes that stand by."""
        board = self._board
        return {
            (topic.name, publisher.name)
            for topic, publisher in board.all()
            if publisher.state is UNKNOWN and board.may_be_silent(topic, publisher)
        }

    def service_of(self, topic: str, publisher: str) -> Optional[Service]:
        """The service that a publisher of `topic` provides, by whose checks it is judged.

        None if nobody can tell.
        """
        found = self._board.topics.get(topic)
        if found is None:
            return None
        known = found.publishers.get(publisher)
        watched = known.watched if known else self._board.watched_of(found, publisher)
        return watched.service if watched else None

    def validate(self) -> None:
        """Raise ShsaError if anything is as it must never be."""
        self._board.validate()

    # The tables of others

    def _som_changed(self, event: SomChanged) -> None:
        before, self._som = self._som, event.som
        for name in before.topics():
            if not event.som.of_topic(name):
                self._board.drop_topic(name)
        for name in event.som.topics():
            if event.som.of_topic(name) != before.of_topic(name):
                topic = self._board.topics.setdefault(name, WatchedTopic(name))
                self._watch(topic, event.time)

    def _watch(self, topic: WatchedTopic, time: float) -> None:
        """Watch a topic for the services that it has now."""
        board, grace = self._board, self._settings.startup_grace
        services = {name: publisher.service for name, publisher in topic.publishers.items()}
        for new in topic.serve(self._som.of_topic(topic.name), self._settings.deadlines, time):
            board.agenda.bring_forward(Grace(topic.name, new), time + grace)
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and nobody.watched not in (None, *topic.services.values()):
            board.drop(topic, NOBODY)
        for publisher in list(topic.publishers.values()):
            if publisher.name != NOBODY:
                watched = board.watched_of(topic, publisher.name)
                publisher.provide(watched, anew=publisher.service != services[publisher.name])
                board.notice(topic, publisher, time)
                board.agenda.bring_forward(Silence(topic.name, publisher.name), publisher.deadline)
        if not topic.publishers:
            board.expect(topic, time)

    def _substitutions_changed(self, event: SubstitutionsChanged) -> None:
        board = self._board
        for node, before, now in board.substitutes.change(event):
            for name in topics_of((before, now)):
                found = board.find(name, node)
                if found is None:
                    continue
                topic, publisher = found
                if now is None:
                    board.substitutes.retired.add((name, node))
                    continue
                board.substitutes.retired.discard((name, node))
                watched = board.watched_of(topic, node)
                publisher.provide(watched, anew=watched is not publisher.watched)
                board.agenda.bring_forward(Silence(name, node), publisher.deadline)
                was_muted = publishes(before, name) and not publishes(now, name)
                if was_muted and publisher.state is HEALTHY:
                    board.mute(topic, publisher, event.time)

    # What publishers do

    def _connected(self, event: Connected) -> None:
        topic = self._board.topics.get(event.topic)
        if topic is None:
            return
        known = topic.publishers.get(event.publisher)
        if known is None or not known.connected:
            self._board.meet(topic, event.publisher, event.time)

    def _disconnected(self, event: Disconnected) -> None:
        board, found = self._board, self._board.find(event.topic, event.publisher)
        if found is None:
            return
        topic, publisher = found
        publisher.connected = False
        detail = "its connection was lost: the node died or left"
        missed = publisher.state is HEALTHY and publisher.watched is not None
        if publisher.state is FAILED:
            publisher.kind, publisher.detail = Kind.NODE_GONE, detail
            board.touch(topic, publisher.name)
        elif missed and not board.may_be_silent(topic, publisher):
            board.fail(topic, publisher, event.time, Kind.NODE_GONE, detail)
        else:
            board.drop(topic, publisher.name)
        board.substitutes.retired.discard((event.topic, event.publisher))
        board.forget_gone(topic)
        if not topic.publishers:
            board.expect(topic, event.time)

    def _message(self, event: Message) -> None:
        topic = self._board.topics.get(event.topic)
        if topic is None:
            return
        publisher = topic.publishers.get(event.publisher)
        if publisher is None:
            publisher = self._board.meet(topic, event.publisher, event.time)
        elif not publisher.connected:
            return
        previous = publisher.last_message
        publisher.note_message(event.time)
        if previous is None:
            self._board.agenda.bring_forward(
                Silence(topic.name, publisher.name), publisher.deadline
            )
        if publisher.watched is not None:
            publisher.watched.published = True
        if self._is_good(topic, publisher, event):
            self._heard_good(topic, publisher, event.time, previous)
        else:
            publisher.good_in_a_row = 0

    def _is_good(self, topic: WatchedTopic, publisher: Publisher, event: Message) -> bool:
        """Whether a message is good; its publisher fails if it was one bad message too many."""
        good, failure = True, None
        if publisher.evidence is not None:
            good, failure = publisher.evidence.weigh(event, publisher.state is FAILED)
        intrusion = self._intrusion(topic, publisher, event.time)
        if intrusion is not None:
            good, failure = False, intrusion
        if failure is not None and publisher.state is not FAILED:
            self._board.fail(topic, publisher, event.time, failure.kind, failure.detail)
        return good

    def _heard_good(
        self, topic: WatchedTopic, publisher: Publisher, time: float, previous: Optional[float]
    ) -> None:
        publisher.last_good = time
        if publisher.state is UNKNOWN:
            self._board.become_healthy(topic, publisher, time)
        elif publisher.state is FAILED:
            watched = publisher.watched
            steady = previous is not None and time - previous <= publisher.allowed
            publisher.good_in_a_row = publisher.good_in_a_row + 1 if steady else 1
            checks = watched.service.checks if watched else Checks()
            if publisher.good_in_a_row >= checks.recovery:
                publisher.forgive()
                self._board.become_healthy(topic, publisher, time)

    def _ending(self, event: Ending) -> None:
        self._ends = True

    # Judgement

    def _tick(self, event: Tick) -> None:
        self._now = event
        for due in self._board.agenda.pop_due(event.time):
            self._judges[type(due)](due)

    def _judge_start(self, due: Grace) -> None:
        """Blame somebody if a service has never been there, once its grace is over."""
        board, time, grace = self._board, self._now.time, self._settings.startup_grace
        topic = board.topics.get(due.topic)
        watched = topic.services.get(due.service) if topic else None
        if topic is None or watched is None or watched.published or watched.overdue:
            return
        if time < watched.began + grace:
            board.agenda.bring_forward(due, watched.began + grace)
            return
        if watched.service.event_driven and watched.appeared:
            return
        watched.overdue = True
        node = watched.service.node
        connected = [p for p in topic.publishers.values() if p.watched is watched]
        guilty = [p for p in connected if p.connected and not board.may_be_silent(topic, p)]
        blamed = min(guilty, key=lambda p: p.name != node, default=None)
        if blamed is None:
            blamed = board.expect(topic, time)
            blamed.provide(watched)
        what = "publisher" if watched.service.event_driven else "message"
        detail = f"no {what} in the first {grace:g} s"
        board.fail(topic, blamed, time, Kind.NEVER_PUBLISHED, detail)

    def _judge_silence(self, due: Silence) -> None:
        """Look at a publisher; what is done about its silence, if that lasts for too long."""
        found = self._board.find(due.topic, due.publisher)
        if found is None:
            return
        if found[1].deadline <= self._now.time:
            self._take_silence(*found)
        self._board.agenda.bring_forward(due, found[1].deadline)

    def _take_silence(self, topic: WatchedTopic, publisher: Publisher) -> None:
        """Mute who may be silent, grant time that the monitor itself has lost, or blame."""
        time, late = self._now.time, self._now.late
        if self._board.may_be_silent(topic, publisher):
            self._board.mute(topic, publisher, time)
            return
        allowed, silence = publisher.allowed, time - (publisher.last_message or 0.0)
        if late >= allowed / 10 and publisher.granted < allowed:
            publisher.granted = silence + min(late, allowed) - allowed
            return
        detail = f"no message for {silence:.3f} s, {allowed:.3f} s are allowed"
        self._board.fail(topic, publisher, time, Kind.SILENT, detail)
        publisher.begin_anew()

    def _intrusion(
        self, topic: WatchedTopic, publisher: Publisher, time: float
    ) -> Optional[Finding]:
        """What is held against a publisher that nobody names beside a healthy one that is."""
        board = self._board
        if not topic.intruder_checks or board.is_named(topic, publisher):
            return None
        if publisher.kind is Kind.UNKNOWN_PUBLISHER:
            return Finding(publisher.kind, publisher.detail)
        rightful = tuple(p.name for p in topic.healthy() if board.is_named(topic, p))
        if not rightful:
            publisher.intruding_since = None
            return None
        if publisher.intruding_since is None:
            publisher.intruding_since = time
        sample = IntruderSample(time - publisher.intruding_since, rightful)
        return judge(topic.intruder_checks, sample)

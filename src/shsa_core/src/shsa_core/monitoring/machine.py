"""The monitor's core: judges each publisher of a service by its messages and connections."""
from math import inf
from typing import Dict, Iterable, List, Optional, Set, Tuple

from shsa_core import dispatch
from shsa_core.model.kinds import Kind
from shsa_core.model.ontology import EMPTY, Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring import changes, events
from shsa_core.monitoring.comparisons import Comparisons
from shsa_core.monitoring.board import FAILED, HEALTHY, UNKNOWN, Board, Grace, Silence
from shsa_core.monitoring.events import Command, Event, Key, PublisherHealth
from shsa_core.monitoring.judgement import Judgement
from shsa_core.monitoring.overview import ServiceHealth, overview
from shsa_core.monitoring.pace import Pace
from shsa_core.monitoring.publishers import NOBODY, Publisher, WatchedTopic
from shsa_core.monitoring.settings import RECONNECT_S, Settings
from shsa_core.monitoring.start_up import StartUp
from shsa_core.monitoring.substitutes import publishes, topics_of
from shsa_core.monitoring.surroundings import Surroundings


class Monitor:
    """Events in, failures and changes of the table of health out; pure, see `handle`."""

    def __init__(self, settings: Settings = Settings(), ontology: Ontology = EMPTY) -> None:
        self._settings = settings
        self._comparisons = Comparisons(ontology, settings.deadlines)
        self._som = Som()
        self._board = Board()
        self._around = Surroundings(lambda: (each for _, each in self._board.all()))
        self._start_up = StartUp(self._board, settings.startup_grace, self._around)
        self._judgement = Judgement(self._board, self._around, self._comparisons)
        self._changes: List[changes.Change] = []
        self._pace = Pace()
        self._ending_nodes: Set[str] = set()
        self._ends = False
        self._handlers: dispatch.Table[None] = dispatch.table(
            Event,
            {
                events.SomChanged: self._som_changed,
                events.Subscribed: self._subscribed,
                events.SubstitutionsChanged: self._substitutions_changed,
                events.FormerlyHealthy: self._start_up.expect,
                events.Connected: self._connected,
                events.Interrupted: self._interrupted,
                events.Disconnected: self._disconnected,
                events.Message: self._message,
                events.Tick: self._tick,
                events.ClockTicked: self._clock_ticked,
                events.NodesEnding: self._nodes_ending,
                events.Ending: self._ending,
            },
        )

    @property
    def next_deadline(self) -> float:
        """The moment in s at which the next Tick is due; inf: none is.

        Messages move it away, save where the learned deadline has become shorter.
        """
        due = None if self._ends else self._board.agenda.next()
        return inf if due is None else self._pace.due(due)

    @property
    def simulated(self) -> bool:
        """True if publishers are judged by /clock as well."""
        return self._pace.simulated

    def handle(self, event: Event) -> List[Command]:
        """Return what `event` brings to light: the rows that changed first."""
        if self._ends:
            return []
        seen = self._pace.judged(event)
        self._handlers[type(event)](seen)
        commands = [*self._board.commands(seen.time), *self._start_up.awaited(seen.time)]
        commands += self._changes
        self._changes = []
        commands += self._comparisons.calibrations.changed(seen.time)
        return self._pace.ours(commands)

    def table(self) -> Tuple[PublisherHealth, ...]:
        """Return the health of every publisher, as of the last event."""
        return self._pace.rows(self._board.table())

    def overview(self) -> Tuple[ServiceHealth, ...]:
        """Return how every service is doing, as of the last event."""
        return overview(self._som, self._board, self.muted())

    def messages(self) -> Dict[Key, int]:
        """Return the number of messages of each publisher so far."""
        return {(topic.name, p.name): p.messages for topic, p in self._board.all()}

    def muted(self) -> Set[Key]:
        """Return the substitutes that stand by: they publish nothing and need not."""
        board = self._board
        return {
            (topic.name, publisher.name)
            for topic, publisher in board.all()
            if publisher.state is UNKNOWN and board.may_be_silent(topic, publisher)
        }

    def service_of(self, topic: str, publisher: str) -> Optional[Service]:
        """Return the service that a publisher of `topic` provides, for whose checks it is read.

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

    def _som_changed(self, event: events.SomChanged) -> None:
        before = self._som
        decided = changes.decide(self._board, event.som, self._settings.deadlines, event.time)
        self._som, self._changes = decided
        self._comparisons.watch(self._som)
        for _, publisher in self._board.all():
            publisher.suspicions.clear()
        for name in before.topics():
            if not self._som.of_topic(name):
                self._board.drop_topic(name)
        for name in self._som.topics():
            if self._som.of_topic(name) != before.of_topic(name):
                topic = self._board.topics.setdefault(name, WatchedTopic(name))
                self._watch(topic, event.time)
        for name in event.unheard:
            if name in self._board.topics:
                self._board.topics[name].subscribed = False

    def _subscribed(self, event: events.Subscribed) -> None:
        topic = self._board.topics.get(event.topic)
        if topic is not None and not topic.subscribed:
            self._start_up.subscribed(topic, event.time)

    def _watch(self, topic: WatchedTopic, time: float) -> None:
        """Watch a topic for the services that it has now."""
        board, grace = self._board, self._settings.startup_grace
        services = {name: publisher.service for name, publisher in topic.publishers.items()}
        for new in topic.serve(
            self._som.of_topic(topic.name), self._settings.deadlines, time + grace
        ):
            board.agenda.bring_forward(Grace(topic.name, new), time + grace)
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and nobody.watched not in (None, *topic.services.values()):
            board.drop(topic, NOBODY)
        for publisher in list(topic.publishers.values()):
            if publisher.name != NOBODY:
                watched = board.watched_of(topic, publisher.name)
                publisher.provide(watched, publisher.service != services[publisher.name])
                board.touch(topic, publisher.name)
                board.notice(topic, publisher, time)
                board.look_when_due(topic, publisher)
        if not topic.publishers:
            board.expect(topic, time)

    def _substitutions_changed(self, event: events.SubstitutionsChanged) -> None:
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
                publisher.provide(watched, watched is not publisher.watched)
                board.touch(topic, publisher.name)
                board.look_when_due(topic, publisher)
                if publishes(before, name) and not publishes(now, name):
                    board.bridges.muted((name, node), event.time)
                    if publisher.state is HEALTHY:
                        board.mute(topic, publisher, event.time)

    # What publishers do

    def _connected(self, event: events.Connected) -> None:
        if not self._board.substitutes.may_be_silent(event.topic, event.publisher):
            self._start_up.came(event.time)
        topic = self._board.topics.get(event.topic)
        if topic is None:
            return
        self._ending_nodes.discard(event.publisher)
        ours = self._board.substitutes.is_known(event.topic, event.publisher)
        self._around.connected(event.publisher, event.time, ours)
        known = topic.publishers.get(event.publisher)
        if known is None or not known.connected or known.uri != event.uri:
            self._board.meet(topic, event.publisher, event.time, event.uri)
        else:
            known.resume(event.time)
            self._board.look_when_due(topic, known)

    def _interrupted(self, event: events.Interrupted) -> None:
        """Nobody is heard who is not connected."""
        found = self._board.find(event.topic, event.publisher)
        if found is not None:
            found[1].interrupt(event.time + RECONNECT_S)

    def _disconnected(self, event: events.Disconnected) -> None:
        board, found = self._board, self._board.find(event.topic, event.publisher)
        if found is None:
            return
        topic, publisher = found
        publisher.connected = False
        detail = "its connection was lost: the node died or left"
        watched = publisher.watched
        missed = watched and (publisher.state is HEALTHY or watched.knew(publisher.name))
        if publisher.state is FAILED:
            publisher.kind, publisher.detail = Kind.NODE_GONE, detail
            board.touch(topic, publisher.name)
        elif missed and not self._may_stop(topic, publisher):
            board.fail(topic, publisher, event.time, Kind.NODE_GONE, detail)
        else:
            board.drop(topic, publisher.name)
        board.substitutes.retired.discard((event.topic, event.publisher))
        board.forget_gone(topic)
        if not topic.publishers:
            board.expect(topic, event.time)
            self._start_up.left(topic, event.time)
        if publisher.name in self._ending_nodes and publisher.watched is not None:
            publisher.watched.overdue = True  # nobody is awaited: who comes is welcome

    def _may_stop(self, topic: WatchedTopic, publisher: Publisher) -> bool:
        """Tell if nobody is to blame for it that a publisher stops."""
        on_purpose = publisher.name in self._ending_nodes
        return on_purpose or self._board.may_be_silent(topic, publisher)

    def _message(self, event: events.Message) -> None:
        topic = self._board.topics.get(event.topic)
        if topic is None:
            return
        publisher = topic.publishers.get(event.publisher)
        if publisher is None:
            publisher = self._board.meet(topic, event.publisher, event.time)
        elif not publisher.connected:
            return
        if self._board.bridge(topic, publisher.name, event.time):
            return
        if self._board.substitutes.is_kept_back(topic.name, publisher.name):
            return  # no consumer hears it
        previous = publisher.last_heard
        excused = publisher.excused_until > -inf
        teaches = publisher.is_healthy and not (excused or publisher.interrupted)
        publisher.note_message(event.time)
        if previous is None or excused:
            self._board.look_when_due(topic, publisher)
        if publisher.watched is not None:
            publisher.watched.published = True
            period = publisher.watched.service.period
            if publisher.backlog.holds(event, previous, publisher.allowed, period):
                return
        good = self._judgement.message(topic, publisher, event, previous)
        if good and teaches and previous is not None:
            self._look_anew(self._around.heard(topic.name, publisher, previous, event.time))

    def _healthy_services(self) -> List[str]:
        """Return the services whose own nodes are healthy, and have told something."""
        found = []
        for service in self._som:
            node = self._board.topics[service.topic].publishers.get(service.node)
            if node is not None and node.is_healthy and node.last_good is not None:
                found.append(service.name)
        return found

    def _clock_ticked(self, event: events.ClockTicked) -> None:
        """Learn stamps anew if our own clock was set."""
        self._around.clock(event.time, event.waited)
        if self._pace.jumped:
            for _topic, publisher in self._board.all():
                if publisher.evidence is not None:
                    publisher.evidence.clock_jumped()

    def _nodes_ending(self, event: events.NodesEnding) -> None:
        self._ending_nodes.update(event.nodes)

    def _ending(self, event: events.Ending) -> None:
        self._ends = True

    # Judgement

    def _tick(self, event: events.Tick) -> None:
        self._around.look(event.time, event.late)
        self._look_anew(self._around.learn())
        for due in self._board.agenda.pop_due(event.time):
            if isinstance(due, Grace):
                self._start_up.judge(due, event.time)
            else:
                self._judge_silence(due, event.time)
        self._comparisons.calibrations.tick(event.time, self._healthy_services)

    def _judge_silence(self, due: Silence, time: float) -> None:
        found = self._board.find(due.topic, due.publisher)
        if found is None:
            return
        topic, publisher = found
        if publisher.deadline <= time:
            if self._may_stop(topic, publisher):
                self._board.mute(topic, publisher, time)
            else:
                self._judgement.silence(topic, publisher, time)
        self._board.look_when_due(topic, publisher)

    def _look_anew(self, keys: Iterable[Key]) -> None:
        """Look at publishers that are allowed another silence."""
        for key in keys:
            found = self._board.find(*key)
            if found is not None:
                self._board.look_when_due(*found)

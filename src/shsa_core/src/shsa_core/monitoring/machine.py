"""The monitor's core: judges each publisher of a service by its messages and connections."""
from math import inf
from typing import List, Optional, Set, Tuple

from shsa_core import dispatch
from shsa_core.model.kinds import QUIET, Kind
from shsa_core.model.ontology import EMPTY, Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.monitoring import changes, events
from shsa_core.monitoring.board import FAILED, HEALTHY, Board, publishes
from shsa_core.monitoring.events import Command, Event
from shsa_core.monitoring.judgement import Judgement
from shsa_core.monitoring.overview import ServiceHealth, overview
from shsa_core.monitoring.pace import Pace
from shsa_core.monitoring.publishers import NOBODY, Publisher, WatchedTopic
from shsa_core.monitoring.settings import RECONNECT_S, Settings
from shsa_core.monitoring.start_up import StartUp
from shsa_core.monitoring.surroundings import Surroundings


class Monitor:
    """Events in, failures and changes of the table of health out; pure, see `handle`."""

    def __init__(self, settings: Settings = Settings(), ontology: Ontology = EMPTY) -> None:
        self._settings = settings
        self._som = Som()
        self._pace = Pace()
        self._board = Board(self._pace.ours)
        self._around = Surroundings(self._board)
        self._start_up = StartUp(self._board, settings.startup_grace, self._around)
        self._judgement = Judgement(self._board, self._around, ontology, settings.deadlines)
        self._ending_nodes: Set[str] = set()
        self._ends = False
        self._handlers: dispatch.Table[None] = dispatch.table(
            Event,
            {
                events.SomChanged: self._som_changed,
                events.Subscribed: self._start_up.subscribed,
                events.SubstitutionsChanged: self._substitutions_changed,
                events.FormerlyHealthy: self._start_up.expect,
                events.Connected: self._connected,
                events.Interrupted: self._interrupted,
                events.Disconnected: self._disconnected,
                events.Message: self._message,
                events.Tick: self._tick,
                events.ClockTicked: self._clock_ticked,
                events.Ending: self._ending,
            },
        )

    @property
    def next_deadline(self) -> float:
        """The moment in s at which the next Tick is due; inf: none is.

        Messages move it away, save where the learned deadline has become shorter.
        """
        return inf if self._ends else self._pace.ours(self._board.agenda.next())

    def handle(self, event: Event) -> List[Command]:
        """Return what `event` brings to light: the rows that changed first."""
        if self._ends:
            return []
        seen = self._pace.judged(event)
        self._board.now = seen.time
        self._handlers[type(event)](seen)
        return self._board.commands()

    def overview(self) -> Tuple[ServiceHealth, ...]:
        """Return how every service is doing, as of the last event."""
        return overview(self._som, self._board)

    def service_of(self, topic: str, publisher: str) -> Optional[Service]:
        """Return the service for whose checks a publisher is read; None if nobody can tell."""
        found, known = self._board.topics.get(topic), self._board.find(topic, publisher)
        if found is None:
            return None
        watched = known.watched if known else self._board.watched_of(found, publisher)
        return watched.service if watched.service.name else None

    # The tables of others

    def _som_changed(self, event: events.SomChanged) -> None:
        before = self._som
        self._som = changes.decide(self._board, event.som, self._settings.deadlines)
        self._judgement.watch(self._som)
        for name in before.topics():
            if not self._som.of_topic(name):
                for publisher in list(self._board.topics.pop(name).publishers.values()):
                    self._board.drop(publisher)
        for name in self._som.topics():
            if self._som.of_topic(name) != before.of_topic(name):
                self._watch(self._board.topics.setdefault(name, WatchedTopic(name)))

    def _watch(self, topic: WatchedTopic) -> None:
        """Watch a topic for the services that it has now."""
        board, due = self._board, self._board.now + self._settings.startup_grace
        for new in topic.serve(self._som.of_topic(topic.name), self._settings.deadlines, due):
            board.agenda.bring_forward(new, due)
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and nobody.watched not in (topic.unknown, *topic.services.values()):
            board.drop(nobody)
        for publisher in list(topic.publishers.values()):
            if publisher.name != NOBODY:
                publisher.provide(board.watched_of(topic, publisher.name))
                board.touch(publisher)
                board.notice(publisher)
                board.look_when_due(publisher)
        if not topic.publishers:
            board.expect(topic)

    def _substitutions_changed(self, event: events.SubstitutionsChanged) -> None:
        board = self._board
        for node, before, now in board.substitutes.change(event):
            rows = [row for row in (before, now) if row is not None]
            for name in dict.fromkeys(topic for row in rows for topic in row.topics):
                publisher = board.find(name, node)
                if publisher is None:
                    continue
                publisher.retired = now is None
                if now is None:
                    continue
                publisher.provide(board.watched_of(publisher.topic, node))
                board.touch(publisher)
                board.look_when_due(publisher)
                if publishes(before, name) and not publishes(now, name):
                    # What comes soon is for those whom it still serves.
                    publisher.filled_in = event.time + CHANGEOVER_S
                    if publisher.state is HEALTHY:
                        board.mute(publisher)

    # What publishers do

    def _connected(self, event: events.Connected) -> None:
        board, name = self._board, event.publisher
        known, row = board.find(event.topic, name), board.substitutes.row(event.topic, name)
        retired = known is not None and known.retired
        if not retired and (row is None or publishes(row, event.topic)):
            self._start_up.came()
        topic = board.topics.get(event.topic)
        if topic is None:
            return
        self._ending_nodes.discard(name)
        self._around.connected(topic, name, retired or row is not None)
        if known is None or not known.connected or known.uri != event.uri:
            board.meet(topic, name, event.uri)
        else:
            known.resume(event.time)
            board.look_when_due(known)

    def _interrupted(self, event: events.Interrupted) -> None:
        """Nobody is heard who is not connected."""
        publisher = self._board.find(event.topic, event.publisher)
        if publisher is not None:
            publisher.interrupt(event.time + RECONNECT_S)

    def _disconnected(self, event: events.Disconnected) -> None:
        board, publisher = self._board, self._board.find(event.topic, event.publisher)
        if publisher is None:
            return
        cut_off = not (event.certain or event.left)
        if cut_off and (publisher.deadline < inf or publisher.kind in QUIET):
            return  # its silence tells
        topic, watched, may_stop = publisher.topic, publisher.watched, self._may_stop(publisher)
        publisher.connected = publisher.retired = False
        kind, detail = Kind.NODE_GONE, "its connection was lost: the node died or left"
        if not event.certain:
            why = "it does not answer" if cut_off else "its node lives, and publishes it no more"
            kind, detail = Kind.SILENT, f"its connection was lost, and {why}"
        formerly = not watched.came and publisher.name == watched.formerly[0]
        was_well = publisher.state is HEALTHY or formerly
        if publisher.state is FAILED:
            publisher.kind, publisher.detail = kind, detail
            board.touch(publisher)
        elif was_well and watched.service.name and not may_stop:
            board.fail(publisher, kind, detail)
        else:
            board.drop(publisher)
        board.forget_gone(topic)
        if not topic.publishers:
            board.expect(topic)
            self._start_up.left(topic)
        if publisher.name in self._ending_nodes:
            watched.came, watched.due = False, inf  # nobody is awaited: who comes is welcome

    def _may_stop(self, publisher: Publisher) -> bool:
        """Tell if nobody is to blame for it that a publisher stops."""
        return publisher.name in self._ending_nodes or self._board.may_be_silent(publisher)

    def _message(self, event: events.Message) -> None:
        topic = self._board.topics.get(event.topic)
        if topic is None:
            return
        publisher = topic.publishers.get(event.publisher)
        if publisher is None:
            publisher = self._board.meet(topic, event.publisher)
        if not publisher.connected or not self._board.is_heard(publisher):
            return
        if event.foreign:
            self._judgement.foreign(publisher, event.foreign)
            return
        previous = publisher.last_heard
        excused = publisher.excused_until > -inf
        interrupted = publisher.reconnects_until > -inf
        teaches = publisher.is_healthy and not (excused or interrupted)
        publisher.note_message(event)
        if previous is None or excused:
            self._board.look_when_due(publisher)
        publisher.watched.come(publisher.name)
        publisher.watched.heard = True
        period, backlog = publisher.service.period or 0.0, publisher.evidence.backlog
        if backlog.holds(event.time, event.age, publisher.allowed, event.waited, period):
            return
        good = self._judgement.message(publisher, event, previous)
        if good and teaches and previous is not None:
            self._around.heard(publisher, previous)

    def _clock_ticked(self, event: events.ClockTicked) -> None:
        """Learn stamps anew if our own clock was set."""
        self._around.clock(event.waited)
        for publisher in self._board.all() if self._pace.jumped else ():
            publisher.evidence.stamps.forget()

    def _ending(self, event: events.Ending) -> None:
        self._ending_nodes.update(event.nodes)
        self._ends = not event.nodes

    # Judgement

    def _tick(self, event: events.Tick) -> None:
        self._around.look(event.late)
        self._around.learn()
        for due in self._board.agenda.pop_due(event.time):
            if isinstance(due, Publisher):
                self._judge_silence(due)
            else:
                self._start_up.judge(due)
        self._judgement.tick()

    def _judge_silence(self, publisher: Publisher) -> None:
        if self._board.find(*publisher.key) is not publisher:
            return
        if publisher.deadline <= self._board.now:
            if self._may_stop(publisher):
                self._board.mute(publisher)
            else:
                self._judgement.silence(publisher)
        self._board.look_when_due(publisher)

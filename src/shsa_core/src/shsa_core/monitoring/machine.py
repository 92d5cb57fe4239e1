"""The monitor's core: judges each publisher of a service by its messages and connections."""
from math import inf
from typing import Dict, Iterable, List, Optional, Set, Tuple

from shsa_core import dispatch
from shsa_core.model.checks import Checks, IntruderSample
from shsa_core.model.kinds import Kind
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.alibis import decide
from shsa_core.monitoring.comparisons import Comparisons
from shsa_core.monitoring.board import FAILED, HEALTHY, UNKNOWN, Board, Due, Grace, Silence, Trial
from shsa_core.monitoring.events import (
    ClockTicked,
    Command,
    Connected,
    Disconnected,
    Ending,
    Event,
    FormerlyHealthy,
    Interrupted,
    Key,
    Message,
    NodesEnding,
    PublisherHealth,
    SomChanged,
    Subscribed,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.evidence import Finding, judge
from shsa_core.monitoring.overview import ServiceHealth, overview
from shsa_core.monitoring.pace import Pace
from shsa_core.monitoring.publishers import NOBODY, Publisher, WatchedTopic
from shsa_core.monitoring.settings import RECONNECT_S, Settings
from shsa_core.monitoring.start_up import StartUp
from shsa_core.monitoring.substitutes import publishes, topics_of
from shsa_core.monitoring.surroundings import Surroundings
from shsa_core.monitoring.trials import Trials


class Monitor:
    """Events in, failures and changes of the table of health out; pure, see `handle`."""

    def __init__(
        self, settings: Settings = Settings(), ontology: Optional[Ontology] = None
    ) -> None:
        self._settings = settings
        self._comparisons = Comparisons(ontology, settings.deadlines) if ontology else None
        self._som = Som()
        self._board = Board()
        self._trials = Trials(self._board, settings.deadlines, self._watch)
        self._around = Surroundings(lambda: (each for _, each in self._board.all()))
        self._start_up = StartUp(self._board, settings.startup_grace)
        self._now = Tick(-inf)
        self._pace = Pace()
        self._ending_nodes: Set[str] = set()
        self._ends = False
        self._handlers: dispatch.Table[None] = dispatch.table(
            Event,
            {
                SomChanged: self._som_changed,
                Subscribed: self._subscribed,
                SubstitutionsChanged: self._substitutions_changed,
                FormerlyHealthy: self._formerly_healthy,
                Connected: self._connected,
                Interrupted: self._interrupted,
                Disconnected: self._disconnected,
                Message: self._message,
                Tick: self._tick,
                ClockTicked: self._clock_ticked,
                NodesEnding: self._nodes_ending,
                Ending: self._ending,
            },
        )
        self._judges: dispatch.Table[None] = dispatch.table(
            Due,
            {
                Silence: self._judge_silence,
                Grace: self._judge_start,
                Trial: self._judge_probation,
            },
        )

    @property
    def next_deadline(self) -> float:
        """When the next Tick is due, in s; inf: none is.

        Messages move it away, save where a deadline is learned that is shorter.
        """
        due = None if self._ends else self._board.agenda.next()
        return inf if due is None else self._pace.due(due)

    @property
    def simulated(self) -> bool:
        """Whether publishers are judged by /clock as well."""
        return self._pace.simulated

    def handle(self, event: Event) -> List[Command]:
        """Return what `event` brings to light: the rows that changed first, then the failures."""
        if self._ends:
            return []
        seen = self._pace.judged(event)
        self._handlers[type(event)](seen)
        commands = [*self._board.commands(seen.time), *self._start_up.awaited(seen.time)]
        if self._comparisons is not None:
            commands += self._comparisons.changed(seen.time)
        return self._pace.ours(commands)

    def table(self) -> Tuple[PublisherHealth, ...]:
        """The health of every publisher, as of the last event."""
        return self._pace.rows(self._board.table())

    def overview(self) -> Tuple[ServiceHealth, ...]:
        """How every service is doing, as of the last event."""
        return overview(self._som, self._board, self.muted())

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
        """The service that a publisher of `topic` provides, for whose checks it is read.

        None if nobody can tell.
        """
        found = self._board.topics.get(topic)
        if found is None:
            return None
        known = found.publishers.get(publisher)
        watched = known.watched if known else self._board.watched_of(found, publisher)
        if watched is None:
            return None
        probation = self._trials.of(found, watched)
        return probation.reading if probation else watched.service

    def validate(self) -> None:
        """Raise ShsaError if anything is as it must never be."""
        self._board.validate()

    # The tables of others

    def _som_changed(self, event: SomChanged) -> None:
        before, self._som = self._som, event.som
        if self._comparisons is not None:
            self._comparisons.watch(event.som)
        for _, publisher in self._board.all():
            publisher.suspicions.clear()
        for name in before.topics():
            if not event.som.of_topic(name):
                self._board.drop_topic(name)
        for name in event.som.topics():
            if event.som.of_topic(name) != before.of_topic(name):
                topic = self._board.topics.setdefault(name, WatchedTopic(name))
                self._trials.begin(topic, self._som.of_topic(name), event.time)
                self._watch(topic, event.time)
        for name in event.unheard:
            if name in self._board.topics:
                self._board.topics[name].subscribed = False

    def _subscribed(self, event: Subscribed) -> None:
        topic = self._board.topics.get(event.topic)
        if topic is not None and not topic.subscribed:
            self._start_up.subscribed(topic, event.time)

    def _watch(self, topic: WatchedTopic, time: float) -> None:
        """Watch a topic for the services that it has now."""
        board, grace = self._board, self._settings.startup_grace
        services = {name: publisher.service for name, publisher in topic.publishers.items()}
        counting = self._trials.counting(topic, self._som.of_topic(topic.name))
        for new in topic.serve(counting, self._settings.deadlines, time + grace):
            board.agenda.bring_forward(Grace(topic.name, new), time + grace)
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and nobody.watched not in (None, *topic.services.values()):
            board.drop(topic, NOBODY)
        for publisher in list(topic.publishers.values()):
            if publisher.name != NOBODY:
                watched = board.watched_of(topic, publisher.name)
                board.provide(
                    topic, publisher, watched, publisher.service != services[publisher.name]
                )
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
                board.provide(topic, publisher, watched, watched is not publisher.watched)
                board.agenda.bring_forward(Silence(name, node), publisher.deadline)
                if publishes(before, name) and not publishes(now, name):
                    board.bridges.muted((name, node), event.time)
                    if publisher.state is HEALTHY:
                        board.mute(topic, publisher, event.time)

    def _formerly_healthy(self, event: FormerlyHealthy) -> None:
        self._start_up.expect(event)

    # What publishers do

    def _connected(self, event: Connected) -> None:
        if not self._board.substitutes.may_be_silent(event.topic, event.publisher):
            self._start_up.came(event.time)
        topic = self._board.topics.get(event.topic)
        if topic is None:
            return
        self._ending_nodes.discard(event.publisher)
        ours = self._board.substitutes.is_known(event.topic, event.publisher)
        self._around.connected(event.publisher, event.time, ours)
        known = topic.publishers.get(event.publisher)
        if known is None or not known.connected:
            self._board.meet(topic, event.publisher, event.time)
        else:
            known.resume(event.time)
            self._board.agenda.bring_forward(Silence(topic.name, known.name), known.deadline)

    def _interrupted(self, event: Interrupted) -> None:
        """Nobody is heard who is not connected."""
        found = self._board.find(event.topic, event.publisher)
        if found is not None:
            found[1].interrupt(event.time + RECONNECT_S)

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
        """Whether nobody is to blame if a publisher stops: it need not publish, or may leave."""
        on_purpose = publisher.name in self._ending_nodes
        return on_purpose or self._board.may_be_silent(topic, publisher)

    def _message(self, event: Message) -> None:
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
        previous = publisher.last_message
        excused = publisher.excused_until > -inf
        teaches = publisher.is_healthy and not (excused or publisher.interrupted)
        publisher.note_message(event.time)
        if previous is None or excused:
            self._board.agenda.bring_forward(
                Silence(topic.name, publisher.name), publisher.deadline
            )
        if publisher.watched is not None:
            publisher.watched.published = True
            period = publisher.watched.service.period
            if publisher.backlog.holds(event, previous, publisher.allowed, period):
                return
        if self._is_good(topic, publisher, event):
            self._heard_good(topic, publisher, event.time, previous)
            if teaches and previous is not None:
                self._look_anew(self._around.heard(topic.name, publisher, previous, event.time))
        else:
            publisher.good_in_a_row = 0

    def _is_good(self, topic: WatchedTopic, publisher: Publisher, event: Message) -> bool:
        """Whether a message is good; its publisher fails if it was one bad message too many."""
        good, failure = True, None
        probation = self._trials.of(topic, publisher.watched)
        seen = probation.for_kept(event) if probation else event
        if publisher.evidence is not None:
            good, failure = publisher.evidence.weigh(seen, publisher.state is FAILED)
            alibi = self._alibi(publisher, failure, event.time) if failure is not None else ""
            if alibi:
                good, failure = True, None
            if alibi or (good and publisher.detail and publisher.kind is None):
                self._board.excuse(topic, publisher, alibi)
        if probation is not None:
            good = self._trials.weigh(topic, publisher, probation, event, good)
        comparisons, time, compared = self._comparisons, event.time, None
        if comparisons is not None:
            compared = comparisons.compare(publisher, seen, good)
            if compared is not None and compared.finding is not None and good:
                good, failure = False, compared.finding
        intrusion = self._intrusion(topic, publisher, time)
        if intrusion is not None:
            good, failure = False, intrusion
        quiet = publisher.kind in (Kind.SILENT, Kind.NEVER_PUBLISHED)
        if failure is not None and (publisher.state is not FAILED or quiet):
            self._board.fail(topic, publisher, time, failure.kind, failure.detail)
        if comparisons is not None and compared is not None:
            comparisons.learn(publisher, compared, time, good)
        return good

    def _alibi(self, publisher: Publisher, failure: Finding, time: float) -> str:
        """Return why a publisher is not blamed for being slow; empty: it is."""
        if failure.kind is not Kind.RATE_LOW or not publisher.is_healthy:
            return ""
        alibi = decide(self._around.rate(publisher, time))
        return alibi.why if alibi else ""

    def _healthy_services(self) -> List[str]:
        """Return the services whose own nodes are healthy, and have told something."""
        found = []
        for service in self._som:
            node = self._board.topics[service.topic].publishers.get(service.node)
            if node is not None and node.is_healthy and node.last_good is not None:
                found.append(service.name)
        return found

    def _heard_good(
        self, topic: WatchedTopic, publisher: Publisher, time: float, previous: Optional[float]
    ) -> None:
        publisher.last_good = time
        if publisher.state is UNKNOWN:
            self._board.become_healthy(topic, publisher, time)
        elif publisher.state is FAILED:
            steady = previous is not None and time - previous <= publisher.allowed
            publisher.good_in_a_row = publisher.good_in_a_row + 1 if steady else 1
            evidence = publisher.evidence
            needed = Checks.recovery if evidence is None else evidence.recovery
            if publisher.good_in_a_row >= needed:
                publisher.forgive()
                self._board.become_healthy(topic, publisher, time)

    def _clock_ticked(self, _: ClockTicked) -> None:
        """What was learned of stamps holds no more if our own clock was set."""
        if self._pace.jumped:
            for _topic, publisher in self._board.all():
                if publisher.evidence is not None:
                    publisher.evidence.clock_jumped()

    def _nodes_ending(self, event: NodesEnding) -> None:
        self._ending_nodes.update(event.nodes)

    def _ending(self, event: Ending) -> None:
        self._ends = True

    # Judgement

    def _tick(self, event: Tick) -> None:
        self._now = event
        self._around.look(event.time, event.late)
        self._look_anew(self._around.learn())
        for due in self._board.agenda.pop_due(event.time):
            self._judges[type(due)](due)
        if self._comparisons is not None:
            self._comparisons.tick(event.time, self._healthy_services)

    def _judge_start(self, due: Grace) -> None:
        self._start_up.judge(due, self._now.time)

    def _judge_silence(self, due: Silence) -> None:
        """Mute who is silent for too long if it may be, excuse or blame it."""
        found, time = self._board.find(due.topic, due.publisher), self._now.time
        if found is None:
            return
        topic, publisher = found
        if publisher.deadline > time:
            self._board.agenda.bring_forward(due, publisher.deadline)
        elif self._may_stop(topic, publisher):
            self._board.mute(topic, publisher, time)
        else:
            self._take_silence(due, topic, publisher, time)

    def _take_silence(
        self, due: Silence, topic: WatchedTopic, publisher: Publisher, time: float
    ) -> None:
        alibi = decide(self._around.silence(publisher))
        if alibi is not None:
            publisher.excused_until = alibi.until
            self._board.excuse(topic, publisher, alibi.why)
            self._board.agenda.bring_forward(due, alibi.until)
            return
        silence = time - (publisher.last_message or 0.0)
        detail = f"no message for {silence:.3f} s, {publisher.allowed:.3f} s are allowed"
        if publisher.learned is not None:
            detail = f"{detail}, {publisher.learned.told()}"
        self._board.fail(topic, publisher, time, Kind.SILENT, detail)
        publisher.begin_anew()

    def _look_anew(self, keys: Iterable[Key]) -> None:
        """These publishers are allowed another silence."""
        for key in keys:
            found = self._board.find(*key)
            if found is not None:
                self._board.agenda.bring_forward(Silence(*key), found[1].deadline)

    def _judge_probation(self, due: Trial) -> None:
        self._trials.look(due, self._around.watch)

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

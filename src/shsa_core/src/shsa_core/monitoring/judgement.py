"""Judges a publisher by its messages, and by its silence."""
from dataclasses import replace
from math import inf, isfinite
from typing import Optional

from shsa_core.codegen.prediction import predictor
from shsa_core.derivations.agreement import Suspicion, Witnesses
from shsa_core.derivations.calibrations import Calibrations
from shsa_core.derivations.evaluation import Derivations
from shsa_core.model.checks import BY_VALUE, Finding, judge
from shsa_core.model.kinds import QUIET, Kind
from shsa_core.model.ontology import Ontology
from shsa_core.model.samples import IntruderSample, ValueSample
from shsa_core.model.service import Deadlines
from shsa_core.model.som import Som
from shsa_core.monitoring.alibis import Alibi, Case, decide
from shsa_core.monitoring.board import FAILED, UNKNOWN, Board
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.publishers import Publisher
from shsa_core.monitoring.surroundings import Surroundings

LATE = (Kind.RATE_LOW, Kind.RATE_HIGH, Kind.STALE_STAMP)
NOT_BLAMED = "not blamed: "


class Judgement:
    """Asks all who know something of a publisher, and tells the board. Times in s."""

    def __init__(
        self, board: Board, around: Surroundings, ontology: Ontology, deadlines: Deadlines
    ) -> None:
        self._board, self._around, self._ontology, self._som = board, around, ontology, Som()
        self._derivations = Derivations(deadlines)
        known = ontology, self._derivations
        self._calibrations = Calibrations(*known, board.is_there, board.say)
        self._witnesses = Witnesses(*known)

    def watch(self, som: Som) -> None:
        """Judge the services of `som` from now on; what is derived of a changed one begins anew."""
        self._som, knows = som, predictor(self._ontology, som.sources)
        self._derivations.watch(som)
        self._calibrations.watch(som, knows)
        self._witnesses.watch(som, knows)
        for each in self._board.all():
            held, compared = each.suspicions, self._witnesses.suspects.get(each.service.name, ())
            each.suspicions = {name: s for name, s in held.items() if s.suspect in compared}

    def tick(self) -> None:
        """Look at what was learned of derivations."""
        self._calibrations.tick(self._board.now)

    def message(self, publisher: Publisher, event: Message, previous: Optional[float]) -> bool:
        """Judge a message, the one before came at `previous`; tell if it is good."""
        good = self._is_good(publisher, event)
        if good:
            publisher.last_good = self._board.now
        healthy = good and publisher.state is UNKNOWN
        if publisher.state is FAILED:
            steady = previous is not None and event.time - previous <= publisher.allowed
            healthy = publisher.evidence.verdict.recovers(good, steady)
            if good and publisher.kind in QUIET:
                self._board.touch(publisher)  # it speaks again: it is not to be ended as silent
        if healthy:
            self._board.become_healthy(publisher)
        return good

    def foreign(self, publisher: Publisher, why: str) -> None:
        """Find a publisher not well that no consumer can hear; it is there, so nobody is missed."""
        watched = publisher.watched
        if publisher.name == watched.service.node and not watched.formerly[0]:
            watched.come(publisher.name)
        if publisher.is_healthy and watched.heard:
            self._board.fail(publisher, Kind.SILENT, why)
            publisher.begin_anew()
            return
        if publisher.is_healthy:  # by its connection alone
            self._board.mute(publisher)
        self._board.note(publisher, why)

    def silence(self, publisher: Publisher) -> None:
        """Excuse or blame who is silent for longer than it is allowed."""
        alibi = decide(self._around.silence(publisher))
        if alibi is not None:
            publisher.excused_until = alibi.until
            self._board.note(publisher, NOT_BLAMED + alibi.why)
            return
        silence = self._board.now - (publisher.last_heard or 0.0)
        detail = f"no message for {silence:.3f} s, {publisher.allowed:.3f} s are allowed"
        if publisher.learned is not None:
            detail = f"{detail}, {publisher.learned.told()}"
        self._board.fail(publisher, Kind.SILENT, detail)
        publisher.begin_anew()

    def _is_good(self, publisher: Publisher, event: Message) -> bool:
        """Fail the publisher if this is one bad message too many; tell if it is good."""
        row = self._board.substitution(publisher)
        written = row.outputs if row is not None and event.topic in row.topics else None
        publisher.evidence.written = None if written is None else {e.field for e in written}
        seen = publisher.evidence.look(event, publisher.state is FAILED)
        alibi = None if seen is None else self._alibi(publisher, seen)
        good = seen is None or alibi is not None
        # What is excused does not count: a little noise beside it would be one bad one too many.
        failure = publisher.evidence.verdict.add(None if good else seen)
        contradicted = self._compare(publisher, event, good)
        for finding in filter(None, (contradicted if good else None, self._intrusion(publisher))):
            # Who was found wrong before its inputs failed is not excused by that.
            convicted = finding is contradicted and publisher.state is FAILED
            excuse = None if convicted else self._alibi(publisher, finding)
            alibi = alibi or excuse
            if excuse is None:
                good, failure = False, finding
        if failure is not None and (publisher.state is not FAILED or publisher.kind in QUIET):
            self._board.fail(publisher, failure.kind, failure.detail)
        notable = publisher.detail or publisher.suspicions or publisher.evidence.unusual
        if publisher.kind is None and (alibi or good and notable):
            self._note(publisher, alibi)
        return good

    def _compare(self, publisher: Publisher, message: Message, good: bool) -> Optional[Finding]:
        """Return what others hold against a `good` message; it teaches if nobody is in doubt."""
        service, evidence = publisher.service, publisher.evidence
        if message.values is None or not self._derivations.concerns(service):
            return None
        if service.node != publisher.name:
            if not self._board.is_there(service):
                self._derivations.unmeasured(service, message.time)
            return None
        named, time = zip(evidence.properties, message.values), message.time
        values = {name: v for name, v in named if v is not None and isfinite(v)}
        if self._derivations.heard(service, values, time, good and publisher.is_healthy):
            for suspect in self._witnesses.suspects[service.name]:
                name = suspect.source.property
                if name not in publisher.suspicions:
                    publisher.suspicions[name] = Suspicion(suspect)
                publisher.suspicions[name].look(values.get(name), time)
        suspicions = publisher.suspicions.values()
        sound = good and publisher.is_healthy and not any(each.doubtful for each in suspicions)
        sound = sound and not self._is_fed_badly(publisher, Kind.WITNESS)
        self._derivations.judged(service, time, sound)
        return next((each.finding for each in suspicions if each.finding), None)

    def _confirms(self, publisher: Publisher, outside: ValueSample) -> bool:
        """Tell if a derived value is about as far out of a range, on the same side."""
        service = publisher.service
        if outside.range is None or service.node != publisher.name:
            return False
        low, high = outside.range
        told = self._derivations.derived(service, outside.name, self._board.now)
        below = outside.value < low
        beyond = low - outside.value if below else outside.value - high
        far = (low - each if below else each - high for each in told)
        return any(0.5 * beyond <= each <= 2.0 * beyond for each in far)

    def _note(self, publisher: Publisher, alibi: Optional[Alibi]) -> None:
        """Tell why a publisher is not blamed, or what is doubtful or unusual of its values."""
        if alibi is not None:
            self._board.note(publisher, NOT_BLAMED + alibi.why, alibi.accuses_som)
            return
        detail = publisher.evidence.unusual
        for suspicion in publisher.suspicions.values():
            detail = suspicion.doubts.get(publisher.service.name) or detail
        self._board.note(publisher, detail, log=bool(detail))

    def _alibi(self, publisher: Publisher, failure: Finding) -> Optional[Alibi]:
        """Return why a publisher is not blamed for its rate, or its values; None: it is."""
        evidence, time = publisher.evidence, self._board.now
        case = Case(failure.kind, time, time)
        if failure.kind in LATE:
            if not publisher.is_healthy:
                return None
            case = self._around.slow(failure.kind, publisher)
            blamed = self._board.is_replaced(publisher)  # if only by a former monitor
            case = replace(case, paced=blamed or evidence.rate_was_good)
        elif failure.kind is Kind.OUT_OF_RANGE and evidence.outside:
            case = self._around.range(publisher, self._confirms(publisher, evidence.outside))
        there, fed_badly = publisher.topic.there, self._is_fed_badly(publisher, failure.kind)
        return decide(replace(case, fed_badly=fed_badly, was_there=publisher.name in there))

    def _is_fed_badly(self, publisher: Publisher, kind: Kind) -> bool:
        """Tell if what a publisher, unless it is a substitute, computes from has the same fault."""
        if not publisher.service.upstream or publisher.name not in publisher.topic.nodes:
            return False
        services, topics = self._som.services, self._board.topics
        read = {services[each].topic for each in publisher.service.upstream if each in services}
        upstream = [each for topic in read for each in topics[topic].feeding(self._board.now)]
        if kind is Kind.RATE_LOW:
            return any(each.is_slow for each in upstream)
        replaced = (each.is_healthy and self._board.is_substitute(each) for each in upstream)
        if kind not in (Kind.OUT_OF_RANGE, *LATE) and any(replaced):
            return True
        bad = (each.evidence.newest_is_bad for each in upstream)
        return any(bad) or any(each.kind in BY_VALUE for each in upstream)

    def _intrusion(self, publisher: Publisher) -> Optional[Finding]:
        """Return what is held against a publisher that nobody names beside a healthy one."""
        board, topic = self._board, publisher.topic
        if not topic.intruder_checks or board.is_named(publisher):
            return None
        if publisher.kind is Kind.UNKNOWN_PUBLISHER:
            return Finding(publisher.kind, publisher.detail)
        rightful = tuple(p.name for p in topic.healthy() if board.is_named(p))
        publisher.intruding_since = min(publisher.intruding_since, board.now) if rightful else inf
        sample = IntruderSample(board.now - publisher.intruding_since, rightful)
        return judge(topic.intruder_checks, sample)

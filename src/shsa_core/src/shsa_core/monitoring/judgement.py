"""Judges a publisher by its messages, and by its silence."""
from dataclasses import replace
from typing import Optional

from shsa_core.model.checks import Checks
from shsa_core.model.samples import IntruderSample
from shsa_core.model.kinds import Kind
from shsa_core.monitoring.alibis import Alibi, Blame, Case, decide
from shsa_core.monitoring.board import FAILED, UNKNOWN, Board
from shsa_core.monitoring.comparisons import Comparisons
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.evidence import Finding, judge
from shsa_core.monitoring.publishers import Publisher, WatchedTopic
from shsa_core.monitoring.surroundings import Surroundings

LATE = {Kind.RATE_LOW: Blame.RATE, Kind.RATE_HIGH: Blame.HASTE, Kind.STALE_STAMP: Blame.STAMP}
NOT_BLAMED = "not blamed: "


class Judgement:
    """Asks all who know something of a publisher, and tells the board. Times in s."""

    def __init__(self, board: Board, around: Surroundings, comparisons: Comparisons) -> None:
        self._board, self._around = board, around
        self._comparisons = comparisons

    def message(
        self, topic: WatchedTopic, publisher: Publisher, event: Message, previous: Optional[float]
    ) -> bool:
        """Judge a message, the one before came at `previous`; tell if it is good."""
        good = self._is_good(topic, publisher, event)
        if good:
            self._heard_good(topic, publisher, event.time, previous)
        else:
            publisher.good_in_a_row = 0
        return good

    def silence(self, topic: WatchedTopic, publisher: Publisher, time: float) -> None:
        """Excuse or blame who is silent for longer than it is allowed."""
        alibi = decide(self._around.silence(publisher))
        if alibi is not None:
            publisher.excused_until = alibi.until
            self._board.note(topic, publisher, NOT_BLAMED + alibi.why, time)
            return
        silence = time - (publisher.last_heard or 0.0)
        detail = f"no message for {silence:.3f} s, {publisher.allowed:.3f} s are allowed"
        if publisher.learned is not None:
            detail = f"{detail}, {publisher.learned.told()}"
        self._board.fail(topic, publisher, time, Kind.SILENT, detail)
        publisher.begin_anew()

    def _is_good(self, topic: WatchedTopic, publisher: Publisher, event: Message) -> bool:
        """Fail the publisher if this is one bad message too many; tell if it is good."""
        good, failure, alibi = True, None, None
        if publisher.evidence is not None:
            publisher.evidence.written = self._board.substitutes.written(topic.name, publisher.name)
            good, failure = publisher.evidence.weigh(event, publisher.state is FAILED)
            if failure is not None:
                alibi = self._alibi(topic, publisher, failure, event.time)
                if alibi is not None:
                    good, failure = True, None
        comparisons, time = self._comparisons, event.time
        compared = comparisons.compare(publisher, event, good)
        if compared is not None and compared.finding is not None and good:
            good, failure = False, compared.finding
        intrusion = self._intrusion(topic, publisher, time)
        if intrusion is not None:
            good, failure = False, intrusion
        quiet = publisher.kind in (Kind.SILENT, Kind.NEVER_PUBLISHED)
        if failure is not None and (publisher.state is not FAILED or quiet):
            self._board.fail(topic, publisher, time, failure.kind, failure.detail)
        if compared is not None:
            comparisons.learn(publisher, compared, time, good)
        if publisher.kind is None and (alibi or good and publisher.is_notable):
            self._note(topic, publisher, alibi, time)
        return good

    def _note(
        self, topic: WatchedTopic, publisher: Publisher, alibi: Optional[Alibi], time: float
    ) -> None:
        """Tell why a publisher is not blamed, or what is doubtful or unusual of its values."""
        if alibi is not None:
            self._board.note(topic, publisher, NOT_BLAMED + alibi.why, time, alibi.accuses_som)
            return
        detail = publisher.evidence.unusual if publisher.evidence else ""
        for suspicion in publisher.suspicions.values():
            detail = suspicion.doubts.get(publisher.service_name) or detail
        self._board.note(topic, publisher, detail, time, log=bool(detail))

    def _alibi(
        self, topic: WatchedTopic, publisher: Publisher, failure: Finding, time: float
    ) -> Optional[Alibi]:
        """Return why a publisher is not blamed for its rate, or its values; None: it is."""
        evidence = publisher.evidence
        case = Case(Blame.VALUE, time, time)
        if failure.kind in LATE:
            if not publisher.is_healthy:
                return None
            case = self._around.slow(LATE[failure.kind], publisher, time)
            named = self._board.is_named(topic, publisher)
            case = replace(case, paced=named or evidence is None or evidence.rate_was_good)
        elif failure.kind is Kind.OUT_OF_RANGE and evidence is not None and evidence.outside:
            confirmed = self._comparisons.confirms(publisher, evidence.outside, time)
            case = self._around.range(publisher, time, confirmed)
        return decide(self._fed(topic, publisher, case))

    def _fed(self, topic: WatchedTopic, publisher: Publisher, case: Case) -> Case:
        """Return a case with what the publisher, unless it is a substitute, computes from."""
        if publisher.service is None or publisher.name not in topic.nodes:
            return case
        board = self._board
        upstream = [*board.upstream(publisher.service)]
        well = ((name, each.name) for name, each in upstream if each.is_healthy)
        return replace(
            case,
            fed_wrong=any(each.tells_wrong for _, each in upstream),
            fed_slowly=any(each.is_slow for _, each in upstream),
            fed_anew=any(board.substitutes.is_known(*key) for key in well),
        )

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
            needed = Checks.recovery if evidence is None else evidence.verdict.recovery
            if publisher.good_in_a_row >= needed:
                if evidence is not None:
                    evidence.verdict.clear()
                self._board.become_healthy(topic, publisher, time)

    def _intrusion(
        self, topic: WatchedTopic, publisher: Publisher, time: float
    ) -> Optional[Finding]:
        """Return what is held against a publisher that nobody names beside a healthy one."""
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

"""Puts changed services on probation: what the numbers so far find good, the new ones must as well.

What a healthy publisher violates at once is a mistake of whoever wrote it. The numbers so far go on
to judge, until the new ones have found enough messages good, or are refused.
"""
from dataclasses import dataclass, field, replace
from typing import Callable, Dict, List, Optional, Sequence, Tuple

from shsa_core.model.checks import LEARNED, Check, Checks
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Deadlines, Service
from shsa_core.monitoring.board import HEALTHY, UNKNOWN, Board, Trial
from shsa_core.monitoring.events import ChangeAdopted, ChangeRefused, Message
from shsa_core.monitoring.evidence import Evidence, Finding, checked_provisions, checks_stamps
from shsa_core.monitoring.publishers import Publisher, WatchedService, WatchedTopic
from shsa_core.watch import Watch


@dataclass
class Probation:
    """One changed `service`; `kept` has the numbers that count meanwhile.

    `allowed`: s of silence that the new numbers allow. `refused`: they do not count, and `kept`
    does until the SOM changes again. `reading`: what messages are decoded for, as both need it.
    """

    service: Service
    kept: Service
    allowed: float
    began: float
    refused: bool = False
    _evidence: Dict[str, Evidence] = field(default_factory=dict)
    _passed: Dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        needed = {each.property for each in checked_provisions(self.service)}
        provides = tuple(
            new if new.property in needed else old
            for new, old in zip(self.service.provides, self.kept.provides)
        )
        stamped = self.service if checks_stamps(self.service) else self.kept
        self.reading = replace(self.kept, provides=provides, checks=stamped.checks)

    def for_kept(self, message: Message) -> Message:
        """Return a message that was decoded for both, as the numbers so far need it."""
        return self._for(self.kept, message)

    def accepts(self, message: Message) -> bool:
        """Tell if the new numbers find nothing wrong with a single message."""
        return not any(Evidence(self.service).findings(self._for(self.service, message), False))

    def weigh(self, publisher: Publisher, message: Message) -> Optional[Finding]:
        """Return what the new numbers hold against a healthy publisher that is good so far."""
        name = publisher.name
        if name not in self._evidence:
            self._evidence[name] = Evidence(self.service, hasty=True)
            if publisher.evidence is not None:
                self._evidence[name].take_times(publisher.evidence)
        _, failure = self._evidence[name].weigh(self._for(self.service, message), False)
        self._passed[name] = self._passed.get(name, 0) + self._evidence[name].knows_rate
        return failure

    def has_passed(self, publisher: Publisher) -> bool:
        """Tell if enough messages of a publisher were judged by all that is new."""
        return self._passed[publisher.name] >= self.service.checks.of

    @property
    def told(self) -> str:
        """The place of the service in its file, and the numbers that differ, in words."""
        new, old = self.service, self.kept
        pairs: List[Tuple[str, object, object]] = [
            ("period", new.period, old.period),
            ("deadline", new.deadline, old.deadline),
            ("checks", new.checks, old.checks),
        ]
        for one, other in zip(new.provides, old.provides):
            pairs.append((f"range of {one.property}", one.range, other.range))
            pairs.append((f"checks of {one.property}", one.checks, other.checks))
        words = [f"{key}: {_word(n)} (so far {_word(o)})" for key, n, o in pairs if n != o]
        return f"{new.where or new.name}: {', '.join(words)}"

    def _for(self, service: Service, message: Message) -> Message:
        """Return a message with the values that the checks of a service need; None: some lack."""
        if message.values is None:
            return message
        named = [each.property for each in checked_provisions(self.reading)]
        found = dict(zip(named, message.values))
        wanted = [each.property for each in checked_provisions(service)]
        complete = found.keys() >= set(wanted)
        return replace(message, values=tuple(found[e] for e in wanted) if complete else None)


class Trials:
    """Puts changed services on probation, and adopts or refuses their new numbers.

    `watch(topic, time)` is called when other numbers count.
    """

    def __init__(
        self, board: Board, deadlines: Deadlines, watch: Callable[[WatchedTopic, float], None]
    ) -> None:
        self._board, self._deadlines, self._watch = board, deadlines, watch
        self._on: Dict[str, Dict[str, Probation]] = {}  # by topic and service

    def begin(self, topic: WatchedTopic, services: Sequence[Service], time: float) -> None:
        """Begin with the changed services of a topic.

        What a healthy publisher is judged by counts on, until it has shown to be good by the new;
        what only allows more counts at once.
        """
        on = self._on[topic.name] = {}
        for service in services:
            watched = topic.services.get(service.name)
            if watched is None or watched.service.node != service.node:
                continue
            if not any(each.watched is watched for each in topic.healthy()):
                continue
            kept = _as_judged(service, watched.service)
            allowed = watched.would_allow(service, self._deadlines)
            looser = allowed >= watched.allowed and _only_loosens(service, kept)
            if kept != service and not looser:
                on[service.name] = Probation(service, kept, allowed, time)
                due = Trial(topic.name, service.name)
                self._board.agenda.bring_forward(due, time + allowed)

    def counting(self, topic: WatchedTopic, services: Sequence[Service]) -> List[Service]:
        """Return the services of a topic, with the numbers that count."""
        on = self._on.get(topic.name, {})
        return [on[each.name].kept if each.name in on else each for each in services]

    def of(self, topic: WatchedTopic, watched: Optional[WatchedService]) -> Optional[Probation]:
        """Return the probation that the service of a publisher is on."""
        on = self._on.get(topic.name)
        found = on.get(watched.service.name) if on and watched else None
        return None if found is None or found.refused else found

    def weigh(
        self,
        topic: WatchedTopic,
        publisher: Publisher,
        probation: Probation,
        event: Message,
        good: bool,
    ) -> bool:
        """Weigh a message by the new numbers as well; tell if it is good.

        A node that starts anew and conforms to them alone decides for them.
        """
        if publisher.state is UNKNOWN and not good and probation.accepts(event):
            self._adopt(topic, probation, event.time)
            return True
        if publisher.state is HEALTHY and good:
            finding = probation.weigh(publisher, event)
            if finding is not None:
                self._refuse(publisher, probation, finding, event.time)
            elif probation.has_passed(publisher):
                self._adopt(topic, probation, event.time)
        return good

    def look(self, due: Trial, watch: Watch) -> None:
        """Refuse a change by which a healthy publisher is silent."""
        topic = self._board.topics.get(due.topic)
        watched = topic.services.get(due.service) if topic else None
        probation = self.of(topic, watched) if topic else None
        if topic is None or probation is None:
            return
        allowed = probation.allowed
        for publisher in (each for each in topic.healthy() if each.watched is watched):
            last = max(probation.began, publisher.last_heard or probation.began)
            if watch.has_passed(last, allowed):
                silence = f"no message for {watch.now - last:.3f} s"
                finding = Finding(Kind.SILENT, f"{silence}, {allowed:.3g} s would be allowed")
                self._refuse(publisher, probation, finding, watch.now)
                return
            self._board.agenda.bring_forward(due, watch.when(last, allowed))

    def _adopt(self, topic: WatchedTopic, probation: Probation, time: float) -> None:
        del self._on[topic.name][probation.service.name]
        self._watch(topic, time)
        self._board.decide(ChangeAdopted(time, probation.service.name, probation.told))

    def _refuse(
        self, publisher: Publisher, probation: Probation, finding: Finding, time: float
    ) -> None:
        probation.refused = True
        why = f"{publisher.name} is healthy, and would fail at once"
        text = f"{probation.told}: {why}: {finding.kind}: {finding.detail}"
        self._board.decide(ChangeRefused(time, probation.kept, text))


def _as_judged(service: Service, so_far: Service) -> Service:
    """Return a service with those numbers of another one by which publishers are judged."""
    old = {each.property: each for each in so_far.provides}
    provides = tuple(
        replace(new, range=old[new.property].range, checks=old[new.property].checks)
        if new.property in old
        else new
        for new in service.provides
    )
    numbers = dict(period=so_far.period, deadline=so_far.deadline, checks=so_far.checks)
    return replace(service, provides=provides, **numbers)


def _only_loosens(service: Service, so_far: Service) -> bool:
    """Tell that nobody can violate the new numbers who does not violate those so far.

    Deadlines are not looked at.
    """
    counts = [(c.bad, c.of, c.seldom) for c in (service.checks, so_far.checks)]
    pairs = list(zip(service.provides, so_far.provides))
    return (
        service.period == so_far.period
        and counts[0] == counts[1]
        and set(service.checks.each) <= set(so_far.checks.each)
        and all(set(new.checks) <= set(old.checks) for new, old in pairs)
        and all(_contains(new.range, old.range) for new, old in pairs)
    )


def _contains(new: Optional[Tuple[float, float]], old: Optional[Tuple[float, float]]) -> bool:
    if new is None or old is None:
        return new is None
    return new[0] <= old[0] and old[1] <= new[1]


def _word(value: object) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, Check):
        return f"{value.kind} " + ("as learned" if value.limit == LEARNED else f"{value.limit:g}")
    if isinstance(value, Checks):
        counts = f"bad {value.bad}", f"of {value.of}", f"recovery {value.recovery}"
        return f"[{', '.join([*map(_word, value.each), *counts])}]"
    return f"[{', '.join(map(_word, value))}]" if isinstance(value, tuple) else str(value)

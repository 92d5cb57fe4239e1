"""A changed service on probation: what the numbers so far find good, the new ones must as well.

What a healthy publisher violates at once is a mistake of whoever wrote it. The numbers so far go on
to judge, until the new ones have found enough messages good, or are refused.
"""
from dataclasses import replace
from typing import Dict, List, Optional, Tuple

from shsa_core.model.checks import LEARNED, Check
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.evidence import (
    Evidence,
    Finding,
    checked_provisions,
    checks_stamps,
)
from shsa_core.monitoring.publishers import Publisher

Values = Optional[Tuple[Optional[float], ...]]
Range = Tuple[float, float]


def as_judged(service: Service, so_far: Service) -> Service:
    """A service with those numbers of another one by which publishers are judged."""
    old = {each.property: each for each in so_far.provides}
    provides = tuple(
        replace(new, range=old[new.property].range, checks=old[new.property].checks)
        if new.property in old
        else new
        for new in service.provides
    )
    return replace(
        service,
        period=so_far.period,
        deadline=so_far.deadline,
        checks=so_far.checks,
        provides=provides,
    )


def only_loosens(service: Service, so_far: Service) -> bool:
    """Whether nobody can violate the new numbers who does not violate those so far.

    Deadlines are not looked at.
    """
    if service.period != so_far.period:
        return False
    counts = [(c.bad, c.of, c.seldom) for c in (service.checks, so_far.checks)]
    pairs = list(zip(service.provides, so_far.provides))
    return (
        counts[0] == counts[1]
        and set(service.checks.each) <= set(so_far.checks.each)
        and all(set(new.checks) <= set(old.checks) for new, old in pairs)
        and all(_contains(new.range, old.range) for new, old in pairs)
    )


def _contains(new: Optional[Range], old: Optional[Range]) -> bool:
    if new is None or old is None:
        return new is None
    return new[0] <= old[0] and old[1] <= new[1]


def changes(service: Service, so_far: Service) -> str:
    """The numbers that differ, in words: `period: 1e+09 (so far 0.02)`."""
    found = [
        f"{key}: {_word(getattr(service, key))} (so far {_word(getattr(so_far, key))})"
        for key in ("period", "deadline", "checks")
        if getattr(service, key) != getattr(so_far, key)
    ]
    for new, old in zip(service.provides, so_far.provides):
        found += [
            f"{key} of {new.property}: {_word(getattr(new, key))} "
            f"(so far {_word(getattr(old, key))})"
            for key in ("range", "checks")
            if getattr(new, key) != getattr(old, key)
        ]
    return ", ".join(found)


def _word(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple) and all(isinstance(each, float) for each in value):
        return f"[{', '.join(f'{each:g}' for each in value)}]"
    if value is None:
        return "none"
    each = getattr(value, "each", value)
    if isinstance(each, tuple):
        words = [f"{check.kind} {_limit(check)}" for check in each]
        counts = [
            f"{n} {getattr(value, n)}" for n in ("bad", "of", "recovery") if hasattr(value, n)
        ]
        return f"[{', '.join(words + counts)}]"
    return str(value)


def _limit(check: Check) -> str:
    return "as learned" if check.limit == LEARNED else f"{check.limit:g}"


class Probation:
    """One changed service; `kept` has the numbers that count meanwhile.

    `allowed`: s of silence that the new numbers allow. `refused`: they do not count, and `kept`
    does until the SOM changes again.
    """

    def __init__(self, service: Service, kept: Service, allowed: float, time: float) -> None:
        self.service, self.kept, self.allowed, self.began = service, kept, allowed, time
        self.refused = False
        self.reading = _reading(service, kept)
        self._evidence: Dict[str, Evidence] = {}
        self._passed: Dict[str, int] = {}

    def for_kept(self, message: Message) -> Message:
        """A message that was decoded for both, as the numbers so far need it."""
        return self._for(self.kept, message)

    def accepts(self, message: Message) -> bool:
        """Whether the new numbers find nothing wrong with a single message."""
        seen = self._for(self.service, message)
        return not any(Evidence(self.service).findings(seen, False))

    def weigh(self, publisher: Publisher, message: Message) -> Optional[Finding]:
        """What the new numbers hold against a healthy publisher whose message is good so far."""
        name = publisher.name
        if name not in self._evidence:
            self._evidence[name] = Evidence(self.service, hasty=True)
            if publisher.evidence is not None:
                self._evidence[name].take_times(publisher.evidence)
        _, failure = self._evidence[name].weigh(self._for(self.service, message), False)
        self._passed[name] = self._passed.get(name, 0) + self._evidence[name].knows_rate
        return failure

    def silence(self, seconds: float) -> Finding:
        """A healthy publisher is silent for longer than the new numbers allow."""
        detail = f"no message for {seconds:.3f} s, {self.allowed:.3g} s would be allowed"
        return Finding(Kind.SILENT, detail)

    def has_passed(self, publisher: Publisher) -> bool:
        """Whether enough messages of a publisher were judged by all that is new."""
        return self._passed[publisher.name] >= self.service.checks.of

    def _for(self, service: Service, message: Message) -> Message:
        return replace(message, values=_pick(message.values, self.reading, service))


def _reading(service: Service, kept: Service) -> Service:
    """What messages are decoded for: whatever one of the two needs to know."""
    needed = {each.property for each in checked_provisions(service)}
    provides: List[Provision] = [
        new if new.property in needed else old for new, old in zip(service.provides, kept.provides)
    ]
    return replace(kept, provides=tuple(provides), checks=_stamped(service, kept).checks)


def _stamped(service: Service, kept: Service) -> Service:
    return service if checks_stamps(service) else kept


def _pick(values: Values, reading: Service, service: Service) -> Values:
    """The values that the checks of a service need; None: some are not there."""
    if values is None:
        return None
    found = dict(zip((each.property for each in checked_provisions(reading)), values))
    wanted = [each.property for each in checked_provisions(service)]
    return tuple(found[each] for each in wanted) if found.keys() >= set(wanted) else None

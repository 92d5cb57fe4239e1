"""Compares how long a failure lasts, detection plus reaction, with what users tolerate.

Both are those of the usual worst case: every check at its limit, and takeovers as slow as the 95th
percentile of those measured (docs/explanation/experiments.md).
"""
from dataclasses import dataclass, replace
from math import ceil
from typing import Iterator, List, Tuple

from shsa_core.healing.settings import EXIT_TIMEOUT_S, Settings
from shsa_core.model.checks import RateHigh, RateLow, Stuck
from shsa_core.model.kinds import Contain, Kind, Policy, Standby
from shsa_core.model.samples import FormulaSample, StampSample, ValueSample
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.settings import RATE_MESSAGES, RATE_SECONDS

TAKEOVERS = {Standby.COLD: 0.83, Standby.WARM: 0.03, Standby.HOT: 0.03}
"""The time in s that a takeover lasts: the 95th percentile of 50 by roscpp."""
TODO = "Give it a shorter deadline, a warm or hot standby, or checks with fewer messages"


@dataclass(frozen=True)
class Budget:
    """The duration in s of a kind of failure for the users of a service.

    `reaction`: from the failure's detection to the first message of what replaces the service.
    """

    kind: Kind
    detection: float
    reaction: float

    @property
    def total(self) -> float:
        """Detection and reaction."""
        return self.detection + self.reaction

    def __str__(self) -> str:
        parts = f"{self.detection:.2f} s until it is found + {self.reaction:.2f} s until it is"
        return f"{self.kind}: {parts} healed = {self.total:.2f} s"


def check_budgets(som: Som, settings: Settings = Settings()) -> Iterator[Tuple[str, str]]:
    """Yield the needed services that are healed later than they may be: where, and the sums."""
    for service in som.may_be_needed():
        tolerated = service.fault_tolerant_time
        if tolerated is None or service.policy is Policy.ADVISE:
            continue
        if len(som.of_topic(service.topic)) > 1:
            service = replace(service, bridge=0.0)  # on a shared topic nobody fills in
        late = [each for each in budgets(service, settings) if each.total > tolerated]
        if late:
            sums = "; ".join(map(str, sorted(late, key=lambda each: -each.total)))
            yield service.where, f"{service.name} tolerates {tolerated:g} s, but: {sums}"


def budgets(service: Service, settings: Settings) -> List[Budget]:
    """Return the budget of each kind of failure that is looked for."""
    reaction = _reaction(service, settings)
    found = [Budget(Kind.NODE_GONE, 0.0, reaction)]
    silence = settings.deadlines.longest(service)
    period = service.period
    if silence is None or period is None:
        return found
    found.append(_of_silence(service, period, silence, reaction))
    # Who publishes what is wrong must be gone before anybody takes its place.
    reaction += settings.kill_patience if service.contain is Contain.NODE else EXIT_TIMEOUT_S
    several = service.checks.bad * period
    for check in (*service.checks.each, *(c for p in service.provides for c in p.checks)):
        if isinstance(check, (RateHigh, RateLow)):
            window = max(RATE_MESSAGES, ceil(RATE_SECONDS / period)) * period
            if isinstance(check, RateLow):
                window /= check.limit
            found.append(Budget(check.kind, window, reaction))
        elif check.sample in (ValueSample, StampSample, FormulaSample):
            waits = check.limit if isinstance(check, Stuck) else 0.0
            found.append(Budget(check.kind, waits + several, reaction))
    return list(dict.fromkeys(found))


def _of_silence(service: Service, period: float, silence: float, reaction: float) -> Budget:
    """Return the budget of silence: a substitute on the same computer fills in a period later."""
    healed = Budget(Kind.SILENT, silence, reaction)
    if service.bridges is None or service.host or not service.policy.substitutes:
        return healed
    filled_in = Budget(Kind.SILENT, service.bridges * period, period)
    return min(healed, filled_in, key=lambda each: each.total)


def _reaction(service: Service, settings: Settings) -> float:
    if not service.policy.substitutes:
        return settings.restart_pause + TAKEOVERS[Standby.COLD]
    return TAKEOVERS[service.standby]

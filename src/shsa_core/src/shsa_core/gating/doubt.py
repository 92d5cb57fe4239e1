"""Doubts a jump of the node's value that its substitute did not see, until the monitor has judged.

The substitute derives the value from other nodes: it is a witness, and so is what the node said
before. Where both contradict, consumers hear the substitute. One derivation alone convicts nobody:
after as long as the monitor's witnesses take, the node is believed unless they contradict as well.
"""
from math import inf
from typing import Dict, Iterable, Optional, Tuple

from shsa_core.gating import settings
from shsa_core.model.checks import LEARNED, Witness
from shsa_core.model.service import Provision, Service, Signal
from shsa_core.monitoring.settings import SAMPLE_S
from shsa_core.monitoring.witness import spread

Values = Dict[str, float]


class Doubt:
    """What speaks against the values of a service's node. Times in s."""

    def __init__(self, service: Service) -> None:
        self._provisions = [
            (each, float(check.limit))
            for each in service.provides
            for check in each.checks
            if isinstance(check, Witness)
        ]
        self._agreed: Dict[str, Tuple[float, float]] = {}  # what both said when they agreed last
        self._since = inf

    def holds(self, said: Values, derived: Values, outputs: Iterable[Signal], time: float) -> bool:
        """Tell if a message is doubted: the node `said` what its substitute did not derive."""
        errors = {each.field: each.error for each in outputs} if self._provisions else {}
        doubted = False
        for provision, stated in self._provisions:
            allowed = spread(errors.get(provision.field)) if stated == LEARNED else stated
            doubted = self._contradicts(provision, allowed, said, derived) or doubted
        self._since = min(self._since, time) if doubted else inf
        if time - self._since > settings.JUDGED_LOOKS * SAMPLE_S:
            self._agreed.clear()
        return doubted

    def _contradicts(
        self, provision: Provision, allowed: Optional[float], said: Values, derived: Values
    ) -> bool:
        value, other = said.get(provision.property), derived.get(provision.property)
        if value is None or other is None or allowed is None:
            return False
        if abs(value - other) <= allowed:
            self._agreed[provision.property] = value, other
            return False
        agreed = self._agreed.get(provision.property)
        if agreed is None:
            return False
        moved, others = abs(value - agreed[0]), abs(other - agreed[1])
        jumped = moved > allowed / 2.0 and moved > 2.0 * others
        if not jumped:
            del self._agreed[provision.property]
        return jumped

"""Doubts a jump of the node's value that its substitute did not see, until the monitor has judged.

The substitute derives the value from other nodes: it is a witness, and so is what the node said
before. Where both contradict, consumers hear the substitute. One derivation alone convicts nobody:
after as long as the monitor's witnesses take, the node is believed unless they contradict as well.
"""
from math import inf
from typing import Dict, Iterable, Optional, Tuple

from shsa_core.derivations.settings import SAMPLE_S
from shsa_core.model.checks import LEARNED, Witness
from shsa_core.model.error import spread
from shsa_core.model.field import difference, is_angle
from shsa_core.model.service import Provision, Service
from shsa_core.model.substitution import Substitution
from shsa_gate import settings

Values = Dict[str, Optional[float]]
Rows = Iterable[Substitution]


class Doubt:
    """Compares the values of a service's node with those of its substitute. Times in s."""

    def __init__(self, service: Service) -> None:
        pairs = ((each, check) for each in service.provides for check in each.checks)
        self._limits = [(p, float(c.limit)) for p, c in pairs if isinstance(c, Witness)]
        self._agreed: Dict[str, Tuple[float, float]] = {}  # what both said when they agreed last
        self._since = inf

    def holds(self, said: Values, derived: Values, rows: Rows, time: float) -> bool:
        """Tell if a message is doubted: the node `said` what its substitute did not derive."""
        errors = {each.field: each.error for row in rows for each in row.outputs}
        doubted = False
        for each, limit in self._limits:
            allowed = spread(errors.get(each.field)) if limit == LEARNED else limit
            value, other = said.get(each.property), derived.get(each.property)
            if allowed is not None and value is not None and other is not None:
                doubted = self._contradicts(each, allowed, value, other) or doubted
        self._since = min(self._since, time) if doubted else inf
        if time - self._since > settings.JUDGED_LOOKS * SAMPLE_S:
            self._agreed.clear()
        return doubted

    def _contradicts(self, of: Provision, allowed: float, value: float, other: float) -> bool:
        agreed, angle = self._agreed.pop(of.property, None), is_angle(of.field)
        if abs(difference(value, other, angle)) <= allowed:
            agreed = value, other
        elif agreed is None or abs(difference(value, agreed[0], angle)) <= max(
            allowed / 2.0, 2.0 * abs(difference(other, agreed[1], angle))
        ):
            return False  # it was so before, or it is the substitute's value that moved
        self._agreed[of.property] = agreed
        return agreed[0] != value

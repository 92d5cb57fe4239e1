"""The pool of idle processes that the warm services share."""
from math import inf
from typing import Dict, List, Optional

from shsa_core.codegen.plans import Plan
from shsa_core.healing.events import Command, Level, Log, StartSubstitute
from shsa_core.healing.planner import Planner
from shsa_core.healing.settings import Settings
from shsa_core.model.kinds import Standby
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution

REFILL_DELAY_S = 1.0
"""The next process is not started beside a takeover: it would take its processor time."""


class Pool:
    """Idle processes, as many as the settings say, while there are warm services.

    They prepare for `plans`, one row a warm service: they listen to its inputs and have advertised
    its outputs, so that the consumers are connected; a roscpp consumer takes 0.2 s for that.
    """

    def __init__(self, settings: Settings) -> None:
        self.nodes: List[str] = []
        self.plans: Dict[str, Substitution] = {}
        self._settings = settings
        self._refill_at = -inf
        self._started: Dict[str, float] = {}

    @staticmethod
    def serves(service: Service) -> bool:
        """Whether a service is warm."""
        return service.needed and service.standby is Standby.WARM and service.policy.substitutes

    @property
    def deadline(self) -> Optional[float]:
        """When one more process is due, in s; None: none is."""
        lacking = bool(self.plans) and len(self.nodes) < self._settings.pool
        return self._refill_at if lacking else None

    @property
    def spare(self) -> str:
        """A process to set to work; empty if there is none."""
        return self.nodes[0] if self.nodes else ""

    @property
    def spare_started(self) -> float:
        """When `spare` was started, in s; it may still be on its way up."""
        return self._started.get(self.spare, -inf)

    def serve(self, service: Service, planner: Planner, plan: Optional[Plan]) -> None:
        """Be ready for a warm service, as far as its plan is known."""
        outputs = tuple(
            planner.som.signal(source, self._settings.deadlines) for source in service.sources
        )
        if plan is None:
            self.plans[service.name] = Substitution("", service.name, (), "", outputs)
            return
        self.plans[service.name] = Substitution(
            "",
            service.name,
            planner.inputs(plan),
            plan.program.code,
            planner.outputs(plan),
            plan.relations,
            plan.quality,
        )

    def forget(self, name: str) -> None:
        """A service is not warm any more."""
        self.plans.pop(name, None)

    def start(self, time: float, name: str) -> List[Command]:
        """Start the process `name`."""
        self.nodes.append(name)
        self._started[name] = time
        return [StartSubstitute(name, None)]

    def take(self, time: float, node: str) -> None:
        """An idle process has been set to work."""
        self._refill_at = time + REFILL_DELAY_S
        self._remove(node)

    def died(self, time: float, node: str, detail: str) -> List[Command]:
        """An idle process has ended by itself; it is replaced after a pause."""
        self._remove(node)
        self._refill_at = time + self._settings.retry
        return [Log(Level.WARN, f"An idle substitute's process died ({detail}).")]

    def _remove(self, node: str) -> None:
        self.nodes.remove(node)
        del self._started[node]

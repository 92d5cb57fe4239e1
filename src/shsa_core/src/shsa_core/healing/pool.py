"""The pool of idle processes that the warm services share."""
from math import inf
from typing import Dict, List, Optional, Set

from shsa_core.agenda import doubled
from shsa_core.codegen.plans import Plan
from shsa_core.healing.events import Command, Level, Log, StartSubstitute, StopSubstitute
from shsa_core.healing.planner import Planner
from shsa_core.healing.settings import Settings
from shsa_core.model.kinds import Standby
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution

REFILL_DELAY_S = 1.0
"""The next process is not started beside a takeover: it would take its processor time."""
LIVED_S = 20.0
"""A process that has lived for so long did not die of what keeps the next from starting."""
START_PAUSE_S = 1.0
"""Nor beside another one: each connects to whatever the warm services read and give."""


class Pool:
    """Idle processes, as many as the settings say, while there are warm services.

    They prepare for `plans`, one row a warm service: they listen to its inputs and have advertised
    its outputs, so that the consumers are connected; a roscpp consumer takes 0.2 s for that.
    """

    def __init__(self, settings: Settings) -> None:
        self.nodes: List[str] = []
        self.plans: Dict[str, Substitution] = {}
        self._heard: Set[str] = set()  # those that have given a sign of life
        self._silent: Set[str] = set()  # those that gave one, and give none now
        self._settings = settings
        self._refill_at = -inf
        self._started: Dict[str, float] = {}
        self._deaths = 0  # one after the other, soon after their starts

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
        """A process to set to work, rather one that was heard already; empty if there is none."""
        ready = [node for node in self.nodes if node not in self._silent]
        return next((node for node in ready if node in self._heard), ready[0] if ready else "")

    @property
    def spare_heard(self) -> bool:
        """Whether `spare` has given a sign of life: it is up."""
        return self.spare in self._heard

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
        self._refill_at = time + START_PAUSE_S
        return [StartSubstitute(name, None)]

    def take_up(self, node: str, started: float) -> None:
        """An idle process of a former reconfigurator is still there."""
        self.nodes.append(node)
        self._started[node] = started

    def take(self, time: float, node: str) -> None:
        """An idle process has been set to work."""
        self._refill_at = time + REFILL_DELAY_S
        self._deaths = 0
        self._remove(node)

    def died(self, time: float, node: str, detail: str) -> List[Command]:
        """An idle process has ended by itself; it is replaced after a pause, which doubles."""
        self._deaths = 0 if time - self._started[node] > LIVED_S else self._deaths + 1
        self._remove(node)
        settings = self._settings
        longest = max(settings.retry, settings.retry_limit)
        self._refill_at = time + doubled(settings.retry, max(0, self._deaths - 1), longest)
        return [Log(Level.WARN, f"An idle substitute's process died ({detail}).")]

    def heard(self, node: str) -> None:
        """A process gives a sign of life."""
        self._silent.discard(node)
        if node in self.nodes:
            self._heard.add(node)

    def silent(self, node: str) -> None:
        """An idle process gives no sign of life just now."""
        self._silent.add(node)

    def hung(self, time: float, node: str) -> List[Command]:
        """An idle process hangs: it is ended and replaced."""
        self._remove(node)
        self._refill_at = min(self._refill_at, time)
        return [StopSubstitute(node), Log(Level.WARN, f"{node} hangs. It is ended and replaced.")]

    def started(self, node: str) -> float:
        """When an idle process was started, in s."""
        return self._started[node]

    def _remove(self, node: str) -> None:
        self.nodes.remove(node)
        self._silent.discard(node)
        self._heard.discard(node)
        del self._started[node]

"""The pool of idle processes that the warm services share."""
from dataclasses import dataclass
from math import inf
from typing import Counter, Dict, List, Optional, Set

from shsa_core.agenda import doubled
from shsa_core.codegen.plans import Plan
from shsa_core.healing.events import Command, Level, Log, StartSubstitute, StopSubstitute
from shsa_core.healing.planner import Planner
from shsa_core.healing.records import IdleProcess
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


@dataclass(frozen=True)
class Spare:
    """An idle process to set to work: when it was started, in s, and whether it was heard.

    Empty: there is none.
    """

    node: str = ""
    started: float = -inf
    heard: bool = False


class Pool:
    """Idle processes: as many as the settings say, wherever warm services are placed.

    They prepare for `plans`, one row a warm service: they listen to its inputs and have advertised
    its outputs, so that the consumers are connected; a roscpp consumer takes 0.2 s for that.
    """

    def __init__(self, settings: Settings) -> None:
        self.nodes: List[str] = []
        self.plans: Dict[str, Substitution] = {}
        self._heard: Set[str] = set()  # those that have given a sign of life
        self._silent: Set[str] = set()  # those that gave one, and give none now
        self._settings = settings
        self._started: Dict[str, float] = {}
        self._hosts: Dict[str, str] = {}  # where each process runs
        self._wanted: Counter[str] = Counter()  # how many plans each computer has
        self._refill_at: Dict[str, float] = {}  # by computer
        self._deaths: Dict[str, int] = {}  # one after the other, soon after their starts

    @staticmethod
    def serves(service: Service) -> bool:
        """Whether a service is warm."""
        return service.needed and service.standby is Standby.WARM and service.policy.substitutes

    @property
    def deadline(self) -> Optional[float]:
        """When one more process is due, in s; None: none is."""
        return min((self._refill_at.get(host, -inf) for host in self._lacking()), default=None)

    def due(self, time: float) -> Optional[str]:
        """A computer on which one more process is due; None: on none."""
        lacking = self._lacking()
        return next((host for host in lacking if self._refill_at.get(host, -inf) <= time), None)

    def _lacking(self) -> List[str]:
        """The computers that warm services are placed on, and that have too few processes."""
        running = list(self._hosts.values())
        return [host for host in sorted(self._wanted) if running.count(host) < self._settings.pool]

    def surplus(self) -> List[str]:
        """The processes on computers that no warm service is placed on any more."""
        wanted = self._wanted
        return [node for node, host in self._hosts.items() if wanted and host not in wanted]

    def on(self, host: str) -> List[str]:
        """The processes on a computer."""
        return [node for node, of in self._hosts.items() if of == host]

    def hosts(self) -> Set[str]:
        """The computers that have a process to set to work."""
        return {host for node, host in self._hosts.items() if node not in self._silent}

    def spare(self, host: str) -> Spare:
        """A process on a computer to set to work, rather one that was heard already."""
        ready = [node for node in self.on(host) if node not in self._silent]
        if not ready:
            return Spare()
        node = next((node for node in ready if node in self._heard), ready[0])
        return Spare(node, self._started[node], node in self._heard)

    def serve(
        self, service: Service, planner: Planner, plan: Optional[Plan], host: str = ""
    ) -> None:
        """Be ready on a computer for a warm service, as far as its plan is known."""
        self.forget(service.name)
        self._wanted[host] += 1
        outputs = tuple(
            planner.som.signal(source, self._settings.deadlines, written=True)
            for source in service.sources
        )
        if plan is None:
            self.plans[service.name] = Substitution("", service.name, (), "", outputs, host=host)
            return
        self.plans[service.name] = Substitution(
            "",
            service.name,
            planner.inputs(plan),
            plan.program.code,
            planner.outputs(plan),
            plan.relations,
            plan.quality,
            host=host,
        )

    def forget(self, name: str) -> None:
        """A service is not warm any more."""
        former = self.plans.pop(name, None)
        if former is not None:
            self._wanted[former.host] -= 1
            self._wanted = +self._wanted  # without those that have none left

    def start(self, time: float, name: str, host: str) -> List[Command]:
        """Start the process `name` on a computer."""
        self.take_up(name, time, host)
        self._refill_at[host] = time + START_PAUSE_S
        return [StartSubstitute(name, None, host=host)]

    def take_up(self, node: str, started: float, host: str) -> None:
        """An idle process of a former reconfigurator is still there."""
        self.nodes.append(node)
        self._started[node] = started
        self._hosts[node] = host

    def take(self, time: float, node: str) -> None:
        """An idle process has been set to work."""
        host = self._hosts[node]
        self._refill_at[host] = time + REFILL_DELAY_S
        self._deaths[host] = 0
        self._remove(node)

    def died(self, time: float, node: str, detail: str) -> List[Command]:
        """An idle process has ended by itself; it is replaced after a pause, which doubles."""
        host = self._hosts[node]
        early = time - self._started[node] <= LIVED_S
        self._deaths[host] = deaths = self._deaths.get(host, 0) + 1 if early else 0
        self._remove(node)
        settings = self._settings
        longest = max(settings.retry, settings.retry_limit)
        self._refill_at[host] = time + doubled(settings.retry, max(0, deaths - 1), longest)
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
        host = self._hosts[node]
        self._refill_at[host] = min(self._refill_at.get(host, -inf), time)
        return [*self.drop(node), Log(Level.WARN, f"{node} hangs. It is ended and replaced.")]

    def drop(self, node: str) -> List[Command]:
        """End an idle process."""
        self._remove(node)
        return [StopSubstitute(node)]

    def record(self, node: str) -> IdleProcess:
        """What is to be known of an idle process after a death."""
        return IdleProcess(node, self._started[node], self._hosts[node])

    def _remove(self, node: str) -> None:
        self.nodes.remove(node)
        self._silent.discard(node)
        self._heard.discard(node)
        del self._started[node], self._hosts[node]

"""The idle processes that the warm services share, and the pace of starts."""
from dataclasses import dataclass
from math import inf
from typing import Callable, Container, Counter, Dict, List, Optional, Set

from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.planning.placement import Computers
from shsa_core.planning.settings import AT_ONCE, LONGEST_START_S, START_S
from shsa_core.table import Keyed


@dataclass(frozen=True)
class IdleProcess(Keyed):
    """An idle process of the pool, when it was started, and on which computer."""

    KEY = "idle {0.node}"
    node: str
    started: float
    host: str = ""


class Pool:
    """Idle processes: `size` of them on each computer on which warm services are placed.

    They listen to the inputs of these services and have advertised their outputs, so that the
    consumers are connected; a roscpp consumer takes 0.2 s for that. `hosts`: the computer of each
    warm service. `heard`: who has given a sign of life. `pause`: s after so many deaths in a row.
    """

    def __init__(self, size: int, pause: Callable[[int], float]) -> None:
        self.processes: Dict[str, IdleProcess] = {}
        self.heard: Set[str] = set()
        self.hosts: Dict[str, str] = {}
        self._size, self._pause = size, pause
        self._wanted: Counter[str] = Counter()  # warm services by computer
        self._refill_at: Dict[str, float] = {}  # by computer
        self._deaths: Dict[str, int] = {}  # one after the other, soon after their starts

    @property
    def deadline(self) -> float:
        """Return when one more process is due, in s; infinite: none is."""
        return min(self._lacking().values(), default=inf)

    def due(self, time: float) -> Optional[str]:
        """Return a computer on which one more process is due; None: on none."""
        return next((host for host, due in self._lacking().items() if due <= time), None)

    def _lacking(self) -> Dict[str, float]:
        """Return when the computers that warm services are placed on, and lack one, get one."""
        running = [each.host for each in self.processes.values()]
        lacking = (host for host in sorted(self._wanted) if running.count(host) < self._size)
        return {host: self._refill_at.get(host, -inf) for host in lacking}

    def surplus(self, computers: Computers) -> List[str]:
        """Return the processes on computers that are lost, or have no warm service any more."""
        left = lambda host: host not in self._wanted or computers.lost(host)
        return [each.node for each in self.processes.values() if left(each.host)]

    def spare(self, host: str, speak: Container[str] = ()) -> Optional[IdleProcess]:
        """Return a process on a computer to set to work, rather one that was heard already.

        `speak`: who publishes the topic. One of these has taken it over by itself.
        """
        here = [each for each in self.processes.values() if each.host == host]
        heard = [each for each in here if each.node in self.heard]
        speaks = [each for each in here if each.node in speak]
        return next(iter(speaks or heard or here), None)

    def serve(self, service: str, host: Optional[str]) -> None:
        """Be ready on a computer for a warm service; None: it is not warm any more."""
        former = self.hosts.pop(service, None)
        if former is not None:
            self._wanted[former] -= 1
        if host is not None:
            self.hosts[service] = host
            self._wanted[host] += 1
        self._wanted = +self._wanted  # without those that have none left

    def add(self, idle: IdleProcess) -> None:
        """Note that an idle process runs."""
        self.processes[idle.node] = idle
        due = self._refill_at.get(idle.host, -inf)
        self._refill_at[idle.host] = max(due, idle.started + CHANGEOVER_S)

    def take(self, time: float, node: str) -> None:
        """Note that an idle process is set to work; the next one is started once that is over."""
        host = self._remove(node).host
        self._refill_at[host] = time + CHANGEOVER_S
        self._deaths[host] = 0

    def died(self, time: float, node: str) -> None:
        """Note that an idle process has ended by itself; the next pause is longer each time."""
        idle = self._remove(node)
        former = self._deaths.get(idle.host, 0) if time - idle.started <= LONGEST_START_S else 0
        self._deaths[idle.host] = former + 1
        self._refill_at[idle.host] = time + self._pause(former)

    def drop(self, node: str) -> None:
        """Note that an idle process is ended: another one is due at once where it is wanted."""
        self._refill_at.pop(self._remove(node).host, None)

    def _remove(self, node: str) -> IdleProcess:
        self.heard.discard(node)
        return self.processes.pop(node)


class Starts:
    """The pace of starts, so that the robot's own nodes are not starved by what stands by.

    A failure never waits: only what is prepared asks for room. `waiting`: services that do.
    `held_until`: nothing that stands by is started before.
    """

    def __init__(self) -> None:
        self.waiting: Dict[str, None] = {}
        self.held_until = -inf
        self._coming: Dict[str, float] = {}  # until when processes are awaited

    @property
    def deadline(self) -> float:
        """Return when the next one may be started at the latest, in s; infinite: nobody waits."""
        if not self.waiting:
            return inf
        ends = sorted(self._coming.values())
        return max(ends[-AT_ONCE] if len(ends) >= AT_ONCE else -inf, self.held_until)

    def began(self, time: float, node: str) -> None:
        """Note that a process is started; forget those that were awaited for long enough."""
        self._coming = {n: end for n, end in self._coming.items() if time < end}
        self._coming[node] = time + START_S

    def over(self, node: str) -> None:
        """Note that a process was heard, or has ended."""
        self._coming.pop(node, None)

    def may(self, time: float, service: str) -> bool:
        """Tell that a service may have a hot substitute started now; else it waits for its turn."""
        if self._room(time):
            return True
        self.waiting[service] = None
        return False

    def due(self, time: float) -> List[str]:
        """Return the services whose turn it is now: no more than have room."""
        names = list(self.waiting)[: self._room(time)]
        for name in names:
            del self.waiting[name]
        return names

    def _room(self, time: float) -> int:
        coming_up = sum(time < end for end in self._coming.values())
        return 0 if time < self.held_until else max(0, AT_ONCE - coming_up)

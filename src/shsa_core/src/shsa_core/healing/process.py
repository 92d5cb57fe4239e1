"""The processes of substitutes: the table of substitutions is what is wanted.

Each computer starts and ends processes as it is told here, and ends by itself those of ours that
nothing wants, as after a cut.
"""
from typing import Dict, List, NamedTuple, Optional, Set, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.healing import events
from shsa_core.healing.events import Command, Level, Log
from shsa_core.healing.health import Health
from shsa_core.healing.naming import Names
from shsa_core.healing.planner import AnyPlan, Planner
from shsa_core.healing.pool import Idle, Pool, Starts
from shsa_core.healing.records import IdleProcess, Record
from shsa_core.healing.settings import Settings
from shsa_core.healing.tables import Table, substitutions
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution, row_key, shared_key


class Worker(NamedTuple):
    """A process that was set to work: when it was started, in s, and whether several share it."""

    node: str
    started: float
    shared: bool
    command: Command


class Processes:
    """Which processes run, where, and for which services.

    `wanted`: the table of substitutions. The first `hot_hosts` hot substitutes on our own computer
    have a process each; those after them share processes of so many at most. None share one whose
    services the same node publishes: so no single fault has two of a process publish, and the end
    of a process takes no more away than where each has its own.
    """

    def __init__(
        self,
        settings: Settings,
        names: Names,
        health: Health,
        records: "Table[Record, events.WriteDown]",
    ) -> None:
        self.wanted = substitutions()
        self.pool = Pool(settings)
        self.starts = Starts()
        self._most = settings.hot_hosts
        self._names = names
        self._health = health
        self._records = records
        self._services: Dict[str, Dict[str, str]] = {}  # by process; and whose they are
        self._elsewhere: Dict[str, str] = {}  # the other computers that processes run on
        self._shared: Dict[str, bool] = {}  # processes that several share; another may join
        self._alone: Set[str] = set()  # services whose hot substitute has its own process

    @property
    def nodes(self) -> Tuple[str, ...]:
        """Return the node names of the processes that run now."""
        return (*self._services, *self.pool.processes)

    @property
    def deadline(self) -> Optional[float]:
        """Return when something that stands by is to be started, in s; None: nothing is."""
        dues = (self.starts.earliest(self.pool.deadline), self.starts.deadline)
        return min((due for due in dues if due is not None), default=None)

    def host(self, node: str) -> str:
        """Return the computer that a process runs on; empty: the reconfigurator's own."""
        return self._elsewhere.get(node, "")

    def served(self, node: str) -> Tuple[str, ...]:
        """Return the services that the substitutes in a process work for."""
        return tuple(self._services.get(node, ()))

    @property
    def substituted(self) -> List[str]:
        """Return the services that have a substitute."""
        return sorted(name for services in self._services.values() for name in services)

    def working_on(self, host: str) -> List[str]:
        """Return the services whose substitute runs on a computer."""
        return [name for node, s in self._services.items() if self.host(node) == host for name in s]

    # One is started, or set to work.

    def set_to_work(
        self,
        time: float,
        service: Service,
        plan: AnyPlan,
        planner: Planner,
        host: str,
        hot: bool,
        ahead: bool,
    ) -> Worker:
        """Set an idle process on a computer to work, let one be shared, or start another.

        `hot`: the service is. `ahead`: nothing has failed yet; then several may share it.
        """
        shared = ahead and isinstance(plan, Plan) and not host and self._shares(service, plan)
        spare = None if shared else self.spare(service, host)
        node, started = "", time
        if shared:
            roomy = (each for each, room in self._shared.items() if room)
            fits = (n for n in roomy if service.node not in self._services[n].values())
            node = next(fits, "")
        elif spare is not None:
            node, started = spare.node, spare.started
            self.pool.remove(time, node)
            self._records.set(f"idle {node}", None)
        command: Command = events.AssignSubstitute(node)
        if not node and shared:
            node = self._names.fresh("host")
            command = self._start(time, events.StartSubstitute(node, None, shared=True))
        elif not node:
            node = self._names.fresh(service.topic.strip("/").replace("/", "_"))
            inputs, outputs = planner.inputs(plan), planner.outputs(plan)
            start = events.StartSubstitute(node, plan.program, inputs, outputs, host)
            command = self._start(time, start)
        self.take_up(service, node, host, shared, hot)
        return Worker(node, started, shared, command)

    def _start(self, time: float, command: events.StartSubstitute) -> events.StartSubstitute:
        self._names.use()
        self._health.substitutes.add(command.node, self.nodes)
        self.starts.began(time, command.node)
        if command.host:
            self._elsewhere[command.node] = command.host
        return command

    def take_up(self, service: Service, node: str, host: str, shared: bool, hot: bool) -> None:
        """Note that a process works for a service."""
        services = self._services.setdefault(node, {})
        services[service.name] = service.node
        if host:
            self._elsewhere[node] = host
        if shared:
            self._shared[node] = len(services) < self._most
        elif hot:
            self._alone.add(service.name)

    def _shares(self, service: Service, plan: Plan) -> bool:
        """Tell that the substitute of a hot service shares a process.

        What is latched, or comes at no period, is told once to a process: who joins later would not
        hear it.
        """
        crowded = 0 < self._most <= len(self._alone - {service.name})
        return crowded and all(source.service.period is not None for source in plan.inputs)

    def spare(self, service: Service, host: str) -> Optional[Idle]:
        """Return an idle process on a computer for a warm service; None: there is none."""
        return self.pool.spare(host) if self.pool.serves(service) else None

    # One ends, or is to end.

    def leave(self, service: str, node: str) -> List[Command]:
        """End the process of a service, unless others share it or it has ended."""
        services = self._services.get(node)
        self._alone.discard(service)
        if services is None:
            return []
        del services[service]
        shared = node in self._shared
        self.wanted.set(shared_key(node, service) if shared else node, None)
        if services:
            self._shared[node] = True
            return []
        self._forget(node)
        return [events.StopSubstitute(node)]

    def exited(self, event: events.ProcessExited) -> Tuple[Tuple[str, ...], List[Command]]:
        """Note that a process has ended by itself. Returns whom it has worked for."""
        node, served = event.node, self.served(event.node)
        self.starts.over(node)
        if node in self.pool.processes:
            self.pool.died(event.time, node)
            self._forget(node)
            text = f"An idle substitute's process died ({event.detail})."
            return (), [Log(Level.WARN, text)]
        for name in served:
            self.leave(name, node)
        return served, []

    def hung(self, node: str) -> List[Command]:
        """End an idle process that hangs, and replace it; others' services do that."""
        if node not in self.pool.processes:
            return []
        text = f"{node} hangs. It is ended and replaced."
        return [*self.drop_idle(node), Log(Level.WARN, text)]

    def silent(self, node: str) -> None:
        """Note that a process gives no sign of life just now: it is not set to work."""
        if node in self.pool.processes:
            self.pool.processes[node].silent = True

    def heard(self, node: str) -> None:
        """Note that a process gives a sign of life."""
        self.starts.over(node)
        if node in self.pool.processes:
            self.pool.processes[node].silent, self.pool.processes[node].heard = False, True

    def drop_idle(self, node: str) -> List[Command]:
        """End an idle process."""
        self.pool.drop(node)
        self._forget(node)
        return [events.StopSubstitute(node)]

    def _forget(self, node: str) -> None:
        self._services.pop(node, None)
        self._shared.pop(node, None)
        self._elsewhere.pop(node, None)
        self.wanted.set(node, None)
        self._records.set(f"idle {node}", None)

    # The pool.

    def stand_by(self, service: Service, planner: Planner, plan: Optional[Plan], host: str) -> None:
        """Let idle processes prepare for a warm service on a computer."""
        self.wanted.set(service.name, self.pool.serve(service, planner, plan, host))

    def no_stand_by(self, service: str) -> None:
        """Prepare for a service no more."""
        self.pool.forget(service)
        self.wanted.set(service, None)

    def refill(self, time: float) -> List[Command]:
        """Start the idle processes that are due, and end those on computers that want none."""
        commands: List[Command] = []
        for node in self.pool.surplus():
            commands += self.drop_idle(node)
        host = None if self.starts.held(time) else self.pool.due(time)
        while host is not None:
            command = events.StartSubstitute(self._names.fresh("standby"), None, host=host)
            commands.append(self._start(time, command))
            self.add_idle(IdleProcess(command.node, time, host))
            host = self.pool.due(time)
        return commands

    def add_idle(self, record: IdleProcess) -> None:
        """Note that an idle process runs."""
        node, host = record.node, record.host
        if host:
            self._elsewhere[node] = host
        self.pool.add(node, record.started, host)
        self.wanted.set(node, Substitution(node, "", (), "", (), host=host))
        self._records.set(record.key, record)

    def show(self, row: Substitution) -> None:
        """Put the row of a service's substitute into the table."""
        self.wanted.set(row_key(row), row)

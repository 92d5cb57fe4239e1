"""The processes of substitutes: the table of substitutions is what is wanted.

Each computer starts and ends processes as it is told here, and ends by itself those of ours that
nothing wants, as after a cut.
"""
from contextlib import suppress
from itertools import count
from typing import Collection, Dict, FrozenSet, List, Optional, Set, Tuple

from shsa_core.codegen.plans import Plan, safe_values
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.events import Command, Log
from shsa_core.healing.robot import Robot
from shsa_core.healing.settings import ANSWER_S, TAKEOVER_S
from shsa_core.model.cost import Cost, cost
from shsa_core.model.kinds import Standby
from shsa_core.model.log import Level
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution, shared_key
from shsa_core.planning.placement import Place, Placement
from shsa_core.planning.pool import IdleProcess, Pool, Starts
from shsa_core.planning.settings import START_S


class Processes:
    """The processes that run: where, and for which services.

    The first `hot_hosts` hot substitutes on our own computer have a process each; those after
    them share processes of so many at most. None share one whose services are of one node, or of
    one topic: so no single fault has two of a process publish, and its end takes no more away than
    where each has its own.
    """

    def __init__(self, robot: Robot) -> None:
        self.wanted = robot.wanted
        self.pool = Pool(robot.settings.pool, robot.settings.paused)
        self.starts = Starts()
        self.substitutes: Dict[str, "Substitute"] = {}
        self._most = robot.settings.hot_hosts
        self._robot = robot
        self._services: Dict[str, Dict[str, Service]] = {}  # by process, and name
        self.placement = Placement(robot.computers, self._placed, lambda: robot.som)
        self._shared: Dict[str, None] = {}  # processes that several share
        self._alone: Set[str] = set()  # services whose hot substitute has its own process

    @property
    def nodes(self) -> Tuple[str, ...]:
        """Return the node names of the processes that run now."""
        return (*self._services, *self.pool.processes)

    @property
    def deadline(self) -> float:
        """Return when something that stands by is to be started, in s; infinite: nothing is."""
        return min(max(self.pool.deadline, self.starts.held_until), self.starts.deadline)

    def served(self, node: str) -> Tuple[str, ...]:
        """Return the services that the substitutes in a process work for."""
        return tuple(self._services.get(node, ()))

    @property
    def substituted(self) -> List[str]:
        """Return the services that have a substitute."""
        return sorted(name for services in self._services.values() for name in services)

    def working_on(self, host: str) -> List[str]:
        """Return the services whose substitute runs on a computer."""
        substitutes = self.substitutes.items()
        return [name for name, each in substitutes if each.node and each.host == host]

    def hold_starts(self, until: float) -> List[Command]:
        """Start nothing that stands by before a moment, in s."""
        self.starts.held_until = until
        return []

    # Where they run.

    def place(self, service: Service, plan: Plan) -> Place:
        """Return the computer for a plan; rather where an idle process is. Raises ShsaError."""
        time, ready = self._robot.time, self.pool.hosts.get(service.name)
        idle = {each.host for each in self.pool.processes.values() if ready is not None}
        return self.placement.place(time, service, self.placement.inputs(plan), ready or "", idle)

    def _placed(self, host: str, since: float) -> List[Cost]:
        """Return what the substitutes cost that were set to work on a computer since a moment."""
        here = {host, self._robot.computers.in_som(host)}
        found = []
        for name in self.working_on(host):
            substitute, service = self.substitutes[name], self._robot.som.services.get(name)
            if service is not None and substitute.plan and substitute.changed > since:
                inputs = [each.service for each in substitute.plan.inputs]
                found.append(cost(inputs, service, here))
        return found

    # One is started, or set to work.

    def set_to_work(self, service: Service, substitute: "Substitute", ahead: bool) -> List[Command]:
        """Set an idle process on a computer to work, let one be shared, or start another.

        The table tells a process that runs. `ahead`: nothing has failed yet; then several may share
        it.
        """
        plan, host, robot = substitute.plan, substitute.host, self._robot
        assert plan is not None
        node, substitute.started = "", robot.time
        substitute.shared = shared = ahead and not host and self._shares(service, plan)
        if shared:
            roomy = (each for each in self._shared if len(self._services[each]) < self._most)
            apart = lambda each: service.node != each.node and service.topic != each.topic
            fits = (n for n in roomy if all(map(apart, self._services[n].values())))
            node = next(fits, "")
        elif standby(service) is Standby.WARM:
            spare = self.pool.spare(host, robot.health.well(service.topic))
            if spare is not None:
                node, substitute.started = spare.node, spare.started
                self.pool.take(robot.time, node)
                robot.records.set(spare.key, None)
        commands: List[Command] = []
        if not node and shared:
            node = robot.names.fresh("host")
            commands = [self._start(events.StartSubstitute(node, None, shared=True))]
        elif not node:
            node = robot.names.fresh(service.topic.strip("/").replace("/", "_"))
            inputs, outputs = robot.planner.signals(plan.inputs), robot.planner.outputs(plan)
            start = events.StartSubstitute(node, plan.program, inputs, outputs, host)
            commands = [self._start(start)]
        substitute.node = node
        self.take_up(service, node, shared)
        return commands

    def _start(self, command: events.StartSubstitute) -> events.StartSubstitute:
        self._robot.health.substitutes.add(command.node, self.nodes)
        self.starts.began(self._robot.time, command.node)
        return command

    def take_up(self, service: Service, node: str, shared: bool) -> None:
        """Note that a process works for a service."""
        self._services.setdefault(node, {})[service.name] = service
        if shared:
            self._shared[node] = None
        elif standby(service) is Standby.HOT:
            self._alone.add(service.name)

    def _shares(self, service: Service, plan: Plan) -> bool:
        """Tell that a substitute may join others, whose process hears what is latched once only."""
        crowded = 0 < self._most <= len(self._alone - {service.name})
        return crowded and all(source.service.period is not None for source in plan.inputs)

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
            return []
        self._forget(node)
        return [events.StopNode(node)]

    def heard(self, node: str) -> List[Command]:
        """Note that a process gives a sign of life."""
        self.starts.over(node)
        if node in self.pool.processes:
            self.pool.heard.add(node)
        return []

    def failed(self, node: str, why: str) -> List[Command]:
        """Replace an idle process that has ended, or hangs; services replace theirs."""
        self.starts.over(node)
        if node not in self.pool.processes:
            return []
        self.pool.died(self._robot.time, node)
        self._forget(node)
        text = f"An idle substitute failed: {why}."
        return [events.StopNode(node), Log(Level.WARN, text)]

    def _forget(self, node: str) -> None:
        self._services.pop(node, None)
        self._shared.pop(node, None)
        self.wanted.set(node, None)
        self._robot.records.set(f"idle {node}", None)

    # The pool.

    def stand_by(self, service: Service, plan: Optional[Plan]) -> None:
        """Let idle processes prepare for a service, if it is warm, where its plan is placed."""
        if standby(service) is not Standby.WARM:
            self.no_stand_by(service.name)
            return
        if plan is not None:
            host = self.placement.stands_by(self._robot.time, service, self.placement.inputs(plan))
        else:
            known = self.pool.hosts.get(service.name, "")
            host = known if self._robot.computers.reachable(known) else ""
        self.pool.serve(service.name, host)
        self.wanted.set(service.name, self._robot.planner.row(service, plan, node="", host=host))

    def no_stand_by(self, service: str) -> None:
        """Prepare for a service no more."""
        self.pool.serve(service, None)
        self.wanted.set(service, None)

    def refill(self, time: float) -> List[Command]:
        """Start the idle processes that are due, and end those on computers that want none."""
        commands: List[Command] = []
        for node in self.pool.surplus(self._robot.computers):
            self.pool.drop(node)
            self._forget(node)
            commands.append(events.StopNode(node))
        host = None if time < self.starts.held_until else self.pool.due(time)
        while host is not None:
            command = events.StartSubstitute(self._robot.names.fresh("standby"), None, host=host)
            commands.append(self._start(command))
            self.add_idle(IdleProcess(command.node, time, host))
            host = self.pool.due(time)
        return commands

    def add_idle(self, idle: IdleProcess) -> None:
        """Note that an idle process runs."""
        self.pool.add(idle)
        rows = (self.wanted.rows.get(node) for node in self.pool.processes)
        taken = [row.bridge for row in rows if row is not None]
        turn = next(turn for turn in count(1) if turn * ANSWER_S not in taken)
        alone = 0.0 if idle.host else turn * ANSWER_S
        row = Substitution(idle.node, "", (), "", (), host=idle.host, bridge=alone)
        self.wanted.set(idle.node, row)
        self._robot.records.set(idle.key, idle)

    def validate(self, owned: Collection[str]) -> None:
        """Raise ShsaError if a row of the table has no process that somebody has, as `owned`."""
        for row in self.wanted.rows.values():
            if row.node and row.node not in owned:
                raise ShsaError(f"{row.node} is in the table of substitutions, but has no owner")
        for idle in self.pool.processes.values():
            if self._robot.computers.lost(idle.host):
                raise ShsaError(f"{idle.node} is idle on a computer that is lost")


def standby(service: Service) -> Standby:
    """Return what is ready before a service fails; cold where nothing would be started."""
    starts = bool(service.needed) and service.policy.substitutes
    return service.standby if starts else Standby.COLD


class Substitute:
    """At most one process that substitutes a service, and its plan.

    `node` is its name, empty without a process; `host`: its computer, empty: the reconfigurator's
    own; `shared`: whether it is that of other services too; `changed`: when it was given its
    program. `working_since` is when it was set to work: what it has published since counts.
    `plan_to_blame`, or else the process is, if no first message comes. `tried`: the plans that were
    tried in vain.
    """

    def __init__(self, service: str, robot: Robot, processes: Processes) -> None:
        self.node = self.host = ""
        self.shared = False
        self.plan: Optional[Plan] = None
        self.working_since = self.changed = 0.0
        self.plan_to_blame = True
        processes.substitutes[service] = self
        self._service = service
        self._robot = robot
        self._processes = processes
        self.started = 0.0
        self.tried: FrozenSet[Plan] = frozenset()
        self._deaths = 0

    @property
    def patience(self) -> float:
        """Return how long its first message may take, in s; one that is coming up is on its way."""
        return max(TAKEOVER_S, self.started + START_S - self.changed)

    @property
    def computes(self) -> bool:
        """Tell that it computes the lost values, and not just safe ones."""
        return self.plan is not None and self.plan.computes

    @property
    def vain(self) -> FrozenSet[Plan]:
        """Return the plans that were tried in vain, if the one that is followed is in vain too."""
        return self.tried if self.plan is None else self.tried | {self.plan}

    @property
    def whole(self) -> bool:
        """Tell that it computes all values of the service."""
        return self.plan is not None and self.plan.computes and not self.plan.left_out

    def find(self, service: Service, faulty: str) -> Plan:
        """Return the plan to follow now: the one followed, if it holds, gives all and may err so.

        Raises ShsaError if there is none.
        """
        plan, planner = self.plan, self._robot.planner
        if plan is not None and self.whole and plan not in self.tried:
            if planner.usable(plan, {faulty}) and not planner.errs_too_much(plan):
                return plan
        return planner.plan(service, self._robot.health.doomed | {faulty}, self.tried)

    def place(self, service: Service, plan: Plan) -> Place:
        """Return where the process at hand runs, or another would. Raises ShsaError."""
        return Place(self.host) if self.node else self._processes.place(service, plan)

    def another(self, service: Service, faulty: str) -> Optional[Plan]:
        """Return the best plan but for that followed and those tried; None: there is none."""
        excluded = self._robot.health.doomed | {faulty}
        with suppress(ShsaError):
            return self._robot.planner.plan(service, excluded, self.vain)
        return None

    def better(self, service: Service, faulty: str) -> Optional[Plan]:
        """Return a plan that errs clearly less by now than the one followed; None: there is none.

        The error of what runs grows where another derivation contradicts it.
        """
        planner, plan = self._robot.planner, self.plan
        if plan is None or not planner.errs_more(plan):
            return None
        another = self.another(service, faulty)
        return another if another is not None and planner.errs_more(plan, another) else None

    def use(
        self,
        service: Service,
        plan: Plan,
        place: Optional[Place] = None,
        publishes: bool = False,
        ahead: bool = False,
    ) -> List[Command]:
        """Set the process at hand, which may publish already, or another to work on a plan.

        `place`: where; None: it is to be found. `ahead`: nothing has failed yet; then that may be
        one that several share. Raises ShsaError if there is no computer for another.
        """
        now = self._robot.time
        place = place or self.place(service, plan)
        self.plan, self.changed = plan, now
        commands: List[Command] = []
        if not self.node:
            self.host = place.host
            commands = self._processes.set_to_work(service, self, ahead)
            if commands or ahead:  # an idle one may have taken the topic over by itself
                self.working_since = now
        self.plan_to_blame = bool(commands) or publishes
        return commands

    def take_up(self, row: Substitution, plan: Plan, working_since: float) -> None:
        """Go on with a process of a former reconfigurator that works on a plan."""
        self.node, self.host, self.shared, self.plan = row.node, row.host, row.shared, plan
        self.working_since = self.started = working_since
        self.changed = self._robot.time
        self.plan_to_blame = False

    def use_safe_values(self, service: Service) -> List[Command]:
        """Have the service's safe values published, if it has any; else no process is left."""
        plan = safe_values(service)
        with suppress(ShsaError):
            if plan is not None and plan not in self.tried:
                return [] if plan == self.plan else self.use(service, plan)
        return self.drop()

    def prepare(self, service: Service) -> List[Command]:
        """Follow the best plan for the case that the service's node fails.

        A process is started for it once there is room. None stands by unless the service is hot.
        """
        robot = self._robot
        with suppress(ShsaError):
            if standby(service) is Standby.HOT:
                ready = robot.planner.plans.plan(service.name)
                plan = ready or robot.planner.explain(service, robot.planned_without(service))
                waits = not self.node and not self._processes.starts.may(robot.time, service.name)
                return [] if plan == self.plan or waits else self.use(service, plan, ahead=True)
        return self.drop()

    def drop(self) -> List[Command]:
        """End the process."""
        node, self.node, self.host, self.shared, self.plan = self.node, "", "", False, None
        return self._processes.leave(self._service, node) if node else []

    def rest(self, service: Service) -> List[Command]:
        """Publish no more: the process of a hot service stands by, others end."""
        return [] if standby(service) is Standby.HOT else self.drop()

    def failed(self, tried: bool) -> List[Command]:
        """End the process, which failed.

        Its plan counts as tried at once if `tried`; else after it died more than `restarts` times.
        """
        self._deaths += 1
        if tried or self._deaths > self._robot.settings.restarts:
            self.tried, self._deaths = self.vain, 0
        return self.drop()

    def forget(self) -> None:
        """Let every plan be tried again."""
        self.tried, self._deaths = frozenset(), 0

"""The substitute of one service: its process, its plan, and which plans were tried in vain."""
from typing import FrozenSet, List, Optional, Set

from shsa_core.codegen.plans import Plan, safe_values
from shsa_core.errors import ShsaError
from shsa_core.healing.events import AssignSubstitute, Command, StartSubstitute
from shsa_core.healing.placement import Place
from shsa_core.healing.planner import AnyPlan
from shsa_core.healing.robot import Robot
from shsa_core.healing.settings import CHANGEOVER_S, LONGEST_START_S, TAKEOVER_S
from shsa_core.model.kinds import Standby
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution


def is_hot(service: Service) -> bool:
    """Tell that a substitute of a service computes before it is needed."""
    return service.needed and service.standby is Standby.HOT and service.policy.substitutes


class Substitute:
    """At most one process that substitutes a service, and its plan.

    `node` is its name, empty without a process; `host`: its computer, empty: the reconfigurator's
    own; `shared`: whether it is that of other services too; `changed`: when it was given its
    program. `working_since` is when it was set to work: what it has published since counts.
    `patience` is how long its first message may take, in s; if that does not come, `plan_to_blame`,
    or else the process is.
    """

    def __init__(self, service: str, robot: Robot) -> None:
        self.node = self.host = ""
        self.shared = False
        self.plan: Optional[AnyPlan] = None
        self.working_since = self.changed = 0.0
        self.patience = TAKEOVER_S
        self.plan_to_blame = True
        self._service = service
        self._robot = robot
        self._started = 0.0
        self._tried: Set[AnyPlan] = set()
        self._deaths = 0

    @property
    def tried(self) -> FrozenSet[Plan]:
        """Return the plans that were tried in vain."""
        return frozenset(each for each in self._tried if isinstance(each, Plan))

    @property
    def computes(self) -> bool:
        """Tell that it computes the lost values, and not just safe ones."""
        return isinstance(self.plan, Plan)

    @property
    def changing(self) -> bool:
        """Tell that it may be silent, as it has changed its program."""
        return self._robot.time < self.changed + CHANGEOVER_S

    @property
    def starting(self) -> bool:
        """Tell that its process may still be on its way up, as on a busy machine."""
        return self._robot.time < self._started + LONGEST_START_S

    @property
    def lost_input(self) -> bool:
        """Tell that something that it reads is not available any more."""
        return isinstance(self.plan, Plan) and not self._robot.planner.usable(self.plan)

    def find(self, service: Service, faulty: str) -> Plan:
        """Return the plan to follow now: the one that is followed, if it still holds.

        Raises ShsaError if there is none.
        """
        plan, planner = self.plan, self._robot.planner
        if isinstance(plan, Plan) and plan not in self._tried and planner.usable(plan, {faulty}):
            return plan
        return planner.plan(service, self.tried, faulty)

    def another(self, service: Service, faulty: str) -> Optional[Plan]:
        """Return the best plan but for that followed and those tried; None: there is none."""
        tried = {*self.tried, *([self.plan] if isinstance(self.plan, Plan) else [])}
        try:
            return self._robot.planner.plan(service, tried, faulty)
        except ShsaError:
            return None

    def leave_plan(self) -> None:
        """Count the plan that is followed as tried; the process goes on."""
        if self.plan is not None:
            self._tried.add(self.plan)

    def place(self, service: Service, plan: AnyPlan) -> Place:
        """Return where a plan is carried out: by the process at hand, or where one is chosen.

        Raises ShsaError if there is no computer for it.
        """
        return Place(self.host) if self.node else self._robot.place(service, plan)

    def use(
        self, service: Service, plan: AnyPlan, publishes: bool = False, ahead: bool = False
    ) -> List[Command]:
        """Set the process at hand, which may publish already, or another to work on a plan.

        `ahead`: nothing has failed yet; then that may be one that several share. Raises ShsaError
        if there is no computer for another.
        """
        robot, now = self._robot, self._robot.time
        host = self.place(service, plan).host
        self.plan, self.changed, starts = plan, now, False
        commands: List[Command] = []
        if self.node:
            commands.append(AssignSubstitute(self.node))
        else:
            self.working_since, self.host = now, host
            worker = robot.processes.set_to_work(
                now, service, plan, robot.planner, host, is_hot(service), ahead
            )
            self.node, self._started, self.shared = worker.node, worker.started, worker.shared
            commands.append(worker.command)
            starts = isinstance(worker.command, StartSubstitute)
        # One that was started a moment ago is on its way: another one would come up no sooner.
        coming_up = self._started + robot.settings.start_timeout - now
        self.patience = max(TAKEOVER_S, coming_up)
        self.plan_to_blame = starts or publishes
        robot.indexes.working[service.name] = now, plan
        return commands

    def take_up(self, row: Substitution, plan: AnyPlan, working_since: float) -> None:
        """Go on with a process of a former reconfigurator that works on a plan."""
        self.node, self.host, self.shared, self.plan = row.node, row.host, row.shared, plan
        self._robot.indexes.working[self._service] = self._robot.time, plan
        self.working_since = self._started = working_since
        self.changed = self._robot.time
        self.plan_to_blame = False

    def use_safe_values(self, service: Service) -> List[Command]:
        """Have the service's safe values published, if it has any; else no process is left."""
        plan = safe_values(service)
        if plan is None or plan in self._tried:
            return self.drop()
        try:
            return [] if plan == self.plan else self.use(service, plan)
        except ShsaError:
            return self.drop()

    def prepare(self, service: Service) -> List[Command]:
        """Follow the best plan for the case that the service's node fails.

        A process is started for it once there is room.
        """
        robot = self._robot
        try:
            plan = robot.planner.ahead(service)
            if plan == self.plan:
                return []
            if not self.node and not robot.processes.starts.may(robot.time, service.name):
                return []
            return self.use(service, plan, ahead=True)
        except ShsaError:
            return self.drop()

    def drop(self) -> List[Command]:
        """End the process."""
        node, self.node, self.host, self.shared, self.plan = self.node, "", "", False, None
        self._robot.indexes.working.pop(self._service, None)
        return self._robot.processes.leave(self._service, node) if node else []

    def failed(self, tried: bool) -> List[Command]:
        """End the process, which failed.

        Its plan counts as tried at once if `tried`; else after it died more than `restarts` times.
        """
        self._deaths += 1
        if self.plan is not None and (tried or self._deaths > self._robot.settings.restarts):
            self._tried.add(self.plan)
            self._deaths = 0
        return self.drop()

    def forget(self) -> None:
        """Let every plan be tried again."""
        self._tried.clear()
        self._deaths = 0

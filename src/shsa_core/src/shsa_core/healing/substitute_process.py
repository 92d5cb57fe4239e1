"""The substitute of one service: its process, its plan, and which plans were tried in vain."""
from typing import List, Optional, Set

from shsa_core.codegen.plans import Plan, safe_values
from shsa_core.errors import ShsaError
from shsa_core.healing.events import AssignSubstitute, Command, StartSubstitute, StopSubstitute
from shsa_core.healing.placement import Place
from shsa_core.healing.planner import AnyPlan
from shsa_core.healing.snapshot import Snapshot
from shsa_core.model.substitution import Substitution

CHANGEOVER_S = 1.0
"""After a change of program, silence is no failure yet for so long."""
LONGEST_START_S = 20.0
"""A process that nobody is connected to by then will not come up any more."""


class SubstituteProcess:
    """At most one process that substitutes a service, and its plan.

    `node` is its name, empty without a process; `host`: its computer, empty: the reconfigurator's
    own; `shared`: whether it is that of other services too; `changed`: when it was given its
    program. `working_since` is when it was set to work: what it has published since counts.
    `patience` is how long its first message may take, in s; if that does not come, `plan_to_blame`,
    or else the process is.
    """

    def __init__(self) -> None:
        self.node = self.host = ""
        self.shared = False
        self.plan: Optional[AnyPlan] = None
        self.working_since = 0.0
        self.patience = 0.0
        self.plan_to_blame = True
        self.changed = 0.0
        self._started = 0.0
        self._tried: Set[AnyPlan] = set()
        self._deaths = 0

    @property
    def tried(self) -> List[Plan]:
        """The plans that were tried in vain."""
        return [each for each in self._tried if isinstance(each, Plan)]

    @property
    def computes(self) -> bool:
        """Whether it computes the lost values, and not just safe ones."""
        return isinstance(self.plan, Plan)

    def changing(self, time: float) -> bool:
        """Whether it may be silent, as it has changed its program."""
        return time < self.changed + CHANGEOVER_S

    def starting(self, time: float) -> bool:
        """Whether its process may still be on its way up, as on a busy machine."""
        return time < self._started + LONGEST_START_S

    def lost_input(self, now: Snapshot) -> bool:
        """Whether something that it reads is not available any more."""
        return isinstance(self.plan, Plan) and not now.planner.usable(self.plan)

    def find(self, now: Snapshot, faulty: str) -> Plan:
        """The plan to follow now: the one that is followed, if it still holds.

        Raises ShsaError if there is none.
        """
        plan = self.plan
        if (
            isinstance(plan, Plan)
            and plan not in self._tried
            and now.planner.usable(plan, {faulty})
        ):
            return plan
        return now.planner.plan(now.service, self.tried, faulty)

    def another(self, now: Snapshot, faulty: str) -> Optional[Plan]:
        """The best plan but for the one that is followed and those tried; None: there is none."""
        tried = [each for each in (*self._tried, self.plan) if isinstance(each, Plan)]
        try:
            return now.planner.plan(now.service, tried, faulty)
        except ShsaError:
            return None

    def leave_plan(self) -> None:
        """The plan that is followed counts as tried; the process goes on."""
        if self.plan is not None:
            self._tried.add(self.plan)

    def place(self, now: Snapshot, plan: AnyPlan) -> Place:
        """Where a plan is carried out: by the process at hand, or on the computer chosen for it.

        Raises ShsaError if there is none.
        """
        return Place(self.host) if self.node else now.place(plan)

    def use(
        self, now: Snapshot, plan: AnyPlan, publishes: bool = False, ahead: bool = False
    ) -> List[Command]:
        """Set the process at hand, which may publish already, or another to work on a plan.

        `ahead`: nothing has failed yet; then that may be one that several share. Raises ShsaError
        if there is no computer for another.
        """
        place = self.place(now, plan)
        self.plan = plan
        self.changed = now.time
        command: Command = AssignSubstitute(self.node)
        if not self.node:
            self.working_since, self.host = now.time, place.host
            command = self._process(now, plan, ahead)
        settings = now.settings
        # One that was started a moment ago is on its way: another one would come up no sooner.
        starting = self._started + settings.start_timeout - now.time
        self.patience = max(settings.takeover_timeout, starting)
        self.plan_to_blame = isinstance(command, StartSubstitute) or publishes
        return [command]

    def take_up(self, time: float, row: Substitution, plan: AnyPlan, working_since: float) -> None:
        """A process of a former reconfigurator works on a plan, as its row says."""
        self.node, self.host, self.shared, self.plan = row.node, row.host, row.shared, plan
        self.working_since = self._started = working_since
        self.changed = time
        self.plan_to_blame = False

    def begin(self, time: float) -> None:
        """A takeover begins: what the process has published before does not count."""
        self.working_since = time

    def use_safe_values(self, now: Snapshot) -> List[Command]:
        """Have the service's safe values published, if it has any; else no process is left."""
        plan = safe_values(now.service)
        if plan is None or plan in self._tried:
            return self.drop()
        try:
            return [] if plan == self.plan else self.use(now, plan)
        except ShsaError:
            return self.drop()

    def prepare(self, now: Snapshot) -> List[Command]:
        """Follow the best plan for the case that the service's node fails.

        A process is started for it once there is room.
        """
        try:
            plan = now.planner.ahead(now.service)
            waits = not self.node and not now.room()
            return [] if waits or plan == self.plan else self.use(now, plan, ahead=True)
        except ShsaError:
            return self.drop()

    def drop(self) -> List[Command]:
        """End the process."""
        commands: List[Command] = [StopSubstitute(self.node)] if self.node else []
        self.node = self.host = ""
        self.shared = False
        self.plan = None
        return commands

    def failed(self, now: Snapshot, tried: bool) -> List[Command]:
        """End the process, which failed.

        Its plan counts as tried at once if `tried`; else after it died more than `restarts` times.
        """
        self._deaths += 1
        if self.plan is not None and (tried or self._deaths > now.settings.restarts):
            self._tried.add(self.plan)
            self._deaths = 0
        return self.drop()

    def forget(self) -> None:
        """Every plan may be tried again."""
        self._tried.clear()
        self._deaths = 0

    def _process(self, now: Snapshot, plan: AnyPlan, ahead: bool) -> Command:
        """Take an idle process on its computer, join one that is shared, or start another there."""
        shared = now.share(plan) if ahead and isinstance(plan, Plan) and not self.host else None
        if shared is not None:
            self.node, self.shared, self._started = shared.node, True, now.time
            if shared.new:
                return StartSubstitute(self.node, None, shared=True)
            return AssignSubstitute(self.node)
        spare = now.spare(self.host)
        if spare.node:
            self.node, self._started = spare.node, spare.started
            return AssignSubstitute(self.node)
        self.node, self._started = now.fresh, now.time
        inputs, outputs = now.planner.inputs(plan), now.planner.outputs(plan)
        return StartSubstitute(self.node, plan.program, inputs, outputs, self.host)

"""The substitute of one topic: its process, what that computes, and which plans were tried in vain."""
from typing import List, Optional, Set

from shsa_core.errors import ShsaError
from shsa_core.healing.events import (
    AssignSubstitute,
    Command,
    StartSubstitute,
    StopSubstitute,
    Substitution,
)
from shsa_core.healing.plans import TopicPlan
from shsa_core.healing.world import World


class StandIn:
    """At most one process that stands in for the publisher of `topic`, and its plan.

    `node` is its name, empty without a process; `assigned` is when it got its plan, and `patience` how long its first
    message may take, in s. If that does not come, `plan_to_blame`, or else the process is.
    """

    def __init__(self, topic: str, world: World) -> None:
        self.topic = topic
        self.node = ""
        self.plan: Optional[TopicPlan] = None
        self.assigned = 0.0
        self.patience = 0.0
        self.plan_to_blame = True
        self._world = world
        self._tried: Set[TopicPlan] = set()
        self._deaths = 0

    @property
    def substitutes(self) -> bool:
        """Whether it computes the lost values, and not just safe ones."""
        return self.plan is not None and not self.plan.safe

    @property
    def usable(self) -> bool:
        """Whether nothing that it reads has been lost."""
        return self.plan is None or self._world.usable(self.plan)

    def row(self, speaking: bool, original: str) -> Optional[Substitution]:
        """Its row in the table of substitutions; None without a process."""
        if self.plan is None:
            return None
        plan = self.plan
        return Substitution(
            self.node, self.topic, plan.program, plan.relations, plan.quality, speaking, original
        )

    def find(self) -> TopicPlan:
        """The plan to follow now: the one that is followed, if it still holds. Raises ShsaError if there is none."""
        plan = self.plan
        if plan is None or plan.safe or plan in self._tried or not self._world.usable(plan):
            return self._world.plan(self.topic, self._tried)
        return plan

    def use(self, time: float, plan: TopicPlan, speaks: bool = False) -> List[Command]:
        """Set the process at hand, which may have been speaking, to work on a plan; else another one."""
        self.plan = plan
        self.assigned = time
        command: Command = AssignSubstitute(self.node)
        if not self.node:
            self.node, command = self._world.process(self.topic, plan.program)
        fresh = isinstance(command, StartSubstitute)
        settings = self._world.settings
        self.patience = settings.start_timeout if fresh else settings.takeover_timeout
        self.plan_to_blame = fresh or speaks
        return [command]

    def use_safe_values(self, time: float) -> List[Command]:
        """Have the topic's safe values published, if it has any; else no process is left."""
        plan = self._world.safe_plan(self.topic)
        if plan is None or plan in self._tried:
            return self.drop()
        return [] if plan == self.plan else self.use(time, plan)

    def prepare(self, time: float) -> List[Command]:
        """Follow the best plan for the case that the topic's node fails."""
        try:
            plan = self._world.plan_ahead(self.topic)
        except ShsaError:
            return self.drop()
        return [] if plan == self.plan else self.use(time, plan)

    def drop(self) -> List[Command]:
        """End the process."""
        commands: List[Command] = [StopSubstitute(self.node)] if self.node else []
        self.node = ""
        self.plan = None
        return commands

    def failed(self, tried: bool) -> List[Command]:
        """End the process, which failed.

        Its plan counts as tried at once if `tried`; else after it died more than `restarts` times.
        """
        self._deaths += 1
        if self.plan is not None and (tried or self._deaths > self._world.settings.restarts):
            self._tried.add(self.plan)
            self._deaths = 0
        return self.drop()

    def forget(self) -> None:
        """Every plan may be tried again."""
        self._tried.clear()
        self._deaths = 0

"""How a faulty node is judged: a plan is searched first, then the node is killed or kept."""
import math
from dataclasses import replace
from typing import Dict, List, Optional, Tuple

from shsa_core.agenda import doubled
from shsa_core.codegen.generator import Program
from shsa_core.codegen.plans import Plan
from shsa_core.errors import NoSubstitute, ShsaError
from shsa_core.healing.events import FailureSeen, Level, Log, RunCommand, ShowIncident
from shsa_core.healing.faulty_node import FaultyNode
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.node_return import NodeReturn
from shsa_core.healing.placement import NoRoom
from shsa_core.healing.rate_limit import HealingRateLimit
from shsa_core.healing.settings import Settings
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.substitute_process import SubstituteProcess
from shsa_core.healing.transitions import Story, Trigger
from shsa_core.model.kinds import Kind, Policy

STUCK = (State.UNHEALED, State.SAFE)
WAITING = (*STUCK, State.KEPT)
NOTHING = Program((), "", ())
NOT_MISSED = ShsaError("nothing is missing")


class Judgement:
    """At most one open incident of one service, and at most one substitute.

    What is decided about the node that it blames.
    """

    def __init__(self, service: str, settings: Settings) -> None:
        self.service = service
        self.incident: Optional[Incident] = None
        self.substitute = SubstituteProcess()
        self.lacks_room = False  # it has a plan, and no computer for it
        self.last_message = b""  # the last good one of the service, serialized
        self._message_came = -math.inf
        self._settings = settings
        self._pauses = 0
        self._timers: Dict[Trigger, float] = {}
        self._faulty = FaultyNode()
        self._return = NodeReturn(settings)
        self._limit = HealingRateLimit(settings.healings)
        self._story = Story(service)
        self._resumes = False  # the kill of its node was not over when a reconfigurator ended

    @property
    def state(self) -> State:
        """How the service does."""
        return State.WELL if self.incident is None else self.incident.state

    @property
    def node(self) -> str:
        """The substitute's node name; empty without one."""
        return self.substitute.node

    @property
    def _kept_out(self) -> bool:
        """Whether the original may not return."""
        return self._return.kept_out or self._limit.exceeded

    def _fire(
        self, now: Snapshot, trigger: Trigger, failure: Optional[FailureSeen] = None
    ) -> List[Request]:
        """Do what the table says. Raises InvalidTransition if it says nothing."""
        before = self.state
        act = getattr(self, self._story.method(before, trigger))
        requests: List[Request] = act(now) if failure is None else act(now, failure)
        self._story.add(now.time, before, trigger, self.state)
        return requests

    def _search(self, now: Snapshot) -> Tuple[Optional[Plan], ShsaError]:
        """The plan to follow now; None: there is none, and why."""
        assert self.incident is not None
        policy = now.service.policy
        self.lacks_room = False
        try:
            if not policy.plans:
                raise ShsaError(f"its policy is {policy}")
            if self._limit.reached(now.time):
                most = self._limit.most
                raise ShsaError(f"it was healed {most} times within a minute, and must be released")
            plan = self.substitute.find(now, self.incident.faulty_node)
            if policy.substitutes:
                self.substitute.place(now, plan)  # is there a computer for it?
            return plan, NOT_MISSED
        except ShsaError as none:
            self.lacks_room = isinstance(none, NoRoom)
            return None, none

    def _judge(self, now: Snapshot, replaced: bool) -> List[Request]:
        """Kill the faulty node, or keep it, unless that is decided."""
        before = self._faulty.decision if self._faulty.kept else ""
        restarted = now.service.policy.restarts and self._return.may_restart
        restarted = restarted and self._faulty.name == now.service.node
        taken_over = self.state is State.HEALED
        requests = self._faulty.judge(now, replaced, restarted, taken_over)
        decided = requests or self._faulty.kept
        if self._faulty.decision != before and decided and self._faulty.kind is not Kind.NODE_GONE:
            text = f"{now.service.topic}: {self._faulty.decision}."
            requests.append(Log(Level.WARN, text))
        return requests

    def _idle(self, now: Snapshot) -> bool:
        """Whether nothing is done: that is the policy, or the node is kept and the policy is to
        start it again.
        """
        policy = now.service.policy
        return policy is Policy.ADVISE or (self._faulty.kept and not policy.substitutes)

    def _keep(self, now: Snapshot, plan: Optional[Plan], none: ShsaError) -> List[Request]:
        """The node is kept, and nobody publishes beside it: say what could be done."""
        assert self.incident is not None
        waits = self.incident.state in WAITING
        due = self._timers.get(Trigger.RETRY) if waits else None
        requests: List[Request] = [] if now.hot else [*self.substitute.drop()]
        self._timers.clear()
        self._timers[Trigger.RETRY] = now.time + self._pause() if due is None else due
        words = now.service.last_resort.command
        acts = now.service.policy is not Policy.ADVISE and self.incident.kind is not Kind.REQUESTED
        if words and acts and not waits:
            requests.append(RunCommand(self.service, words))
        could = f"It cannot be replaced: {none}"
        if plan is not None:
            could = f"It could be replaced: {told(plan)}"
        detail = f"{now.service.topic}: {self._faulty.decision}. {could}."
        if self.incident.state is State.KEPT and self.incident.detail == detail:
            return requests
        program = plan.program if plan else NOTHING
        return requests + self._step(
            state=State.KEPT,
            faulty_node=self._faulty.name,
            killed=None if self._faulty.kept else self.incident.killed,
            detail=detail,
            missing=none.missing if isinstance(none, NoSubstitute) else (),
            unavailable=now.planner.unavailable(self.service),
            substitute="",
            inputs=program.inputs,
            code=program.code,
            outputs=program.outputs,
            relations=plan.relations if plan else (),
            quality=plan.quality if plan else None,
            errors=now.planner.errors(plan) if plan else (),
        )

    def _pause(self) -> float:
        """How long to wait before the next try, in s."""
        self._pauses += 1
        return doubled(self._settings.retry, self._pauses - 1, self._settings.retry_limit)

    def _step(self, **changes: object) -> List[Request]:
        assert self.incident is not None
        changes.update(
            restarts=self._return.restarts,
            kept_out=self._kept_out,
            kept=self._faulty.kept,
            decision=self._faulty.decision,
        )
        self.incident = replace(self.incident, **changes)  # type: ignore[arg-type]
        return [ShowIncident(self.incident)]


def told(plan: Plan) -> str:
    """A plan in words."""
    using = ", ".join(plan.relations) or "the same property elsewhere"
    inputs = ", ".join(plan.program.inputs) or "constants"
    return f"quality {plan.quality:.2g} by {using} from {inputs}"

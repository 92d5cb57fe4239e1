"""The healing of one topic: a state machine, fed by the reconfigurator."""
from dataclasses import replace
from typing import List, Optional, Set

from shsa_core.checks import NODE_GONE, SILENT
from shsa_core.errors import NoSubstitute, ShsaError
from shsa_core.events import (
    AssignSubstitute,
    Command,
    FailureSeen,
    NodeKilled,
    Say,
    ShowIncident,
    StopSubstitute,
    SubstituteStarted,
    Substitution,
)
from shsa_core.incident import Incident, State
from shsa_core.plans import TopicPlan
from shsa_core.world import World

CHANGEOVER = 1.0  # s after a change of program in which silence is no failure yet


class Healing:
    """The healing of one topic: at most one open incident, at most one substitute.

    A hot topic has its substitute before the incident and keeps it after: mute, and computing.
    """

    def __init__(self, topic: str, world: World) -> None:
        self.topic = topic
        self.incident: Optional[Incident] = None
        self.node = ""
        self.plan: Optional[TopicPlan] = None
        self._world = world
        self._certainly_gone = False
        self._assigned = 0.0
        self._tried: Set[TopicPlan] = set()
        self._deaths = 0
        self._pauses = 0
        self._deadline: Optional[float] = None

    @property
    def open(self) -> bool:
        """Whether an incident is open."""
        return self.incident is not None

    @property
    def deadline(self) -> Optional[float]:
        """When `tick` has something to do, in s; None: nothing is due."""
        return self._deadline

    @property
    def substitution(self) -> Optional[Substitution]:
        """The row of this topic in the table of substitutions; None without a substitute.

        A substitute speaks only when the faulty node is gone and the original is not back: one voice.
        """
        if self.plan is None:
            return None
        return Substitution(
            self.node,
            self.topic,
            self.plan.program,
            self.plan.relations,
            self.plan.quality,
            speaking=self._speaking(self.incident),
            original=self.incident.faulty_node if self.incident and self.incident.killed else "",
        )

    def _speaking(self, incident: Optional[Incident]) -> bool:
        if incident is None or incident.state not in (State.HEALING, State.HEALED):
            return False
        return self._certainly_gone or not self._world.dying(incident.faulty_node)

    def failed(self, event: FailureSeen) -> List[Command]:
        """A publisher of the topic failed: kill it, and heal unless another original carries on."""
        if self.node and event.publisher == self.node:
            return self._own_failed(event)
        node = event.publisher or self._world.provider(self.topic)
        commands = self._world.kill(node, urgent=event.kind != NODE_GONE)
        if self.incident is None:
            healthy = [
                row.publisher
                for row in self._world.originals(self.topic)
                if row.state == "healthy" and row.publisher != node
            ]
            if healthy:
                text = f"{self.topic}: {node} failed ({event.detail}); {healthy[0]} carries on."
                return [*commands, Say("warn", text)]
            self._certainly_gone = event.kind == NODE_GONE
            return commands + self._open(event, node)
        text = f"{self.topic}: {node} failed again: {event.detail}."
        commands.append(Say("warn", text))
        if self.incident.state is not State.RETURNING:
            return commands
        self._certainly_gone = event.kind == NODE_GONE
        self._deadline = None
        commands += self._step(
            state=State.HEALED if self.plan else State.HEALING,
            faulty_node=node,
            killed=None,
            returned=None,
            detail=text,
        )
        return commands if self.plan else commands + self._heal(event.time)

    def _own_failed(self, event: FailureSeen) -> List[Command]:
        """Our substitute failed, or fell silent while it changes its program."""
        if self.incident is not None and event.last_good is not None:
            self.incident = replace(self.incident, last_good=event.last_good)
        if event.kind == SILENT and event.time < self._assigned + CHANGEOVER:
            self._deadline = self._assigned + self._world.settings.start_timeout
            return self._step(state=State.HEALING, first_message=None) if self.incident else []
        return self._substitute_failed(event.time, event.detail, event.kind != NODE_GONE)

    def killed(self, event: NodeKilled) -> List[Command]:
        """A faulty node is gone, or cannot be reached to make sure."""
        if self.incident is None or self.incident.faulty_node != event.node:
            return []
        if event.certain:
            return self._step(killed=event.time)
        text = f"{self.topic}: {event.node} may still be running: {event.detail}."
        return [Say("error", text), *self._step(detail=text)]

    def started(self, event: SubstituteStarted) -> List[Command]:
        """The substitute was set to work."""
        if self.incident is None or event.node != self.node:
            return []
        return self._step(found=event.found, spawned=event.time)

    def exited(self, time: float, node: str, detail: str) -> List[Command]:
        """A substitute's process ended."""
        if node != self.node:
            return []
        return self._substitute_failed(time, f"its process died ({detail})", False)

    def world_changed(self, time: float) -> List[Command]:
        """Health or SOM changed: the first message, a lost input, the original's return, a new chance."""
        if self.incident is None:
            return self._prepare(time)
        commands = self._notice_first_message() + self._notice_return(time)
        if self.incident.state in (State.HEALING, State.HEALED):
            if self.plan is not None and not self._world.usable(self.plan):
                commands.append(Say("warn", f"{self.topic}: the substitute lost an input."))
                commands += self._heal(time)
        elif self.incident.state is State.UNHEALED:
            commands += self._heal(time)
        return commands

    def tick(self, time: float) -> List[Command]:
        """Time passed: the substitute is late, the hold-off is over, or a new try is due."""
        if self._deadline is None or time < self._deadline:
            return []
        self._deadline = None
        if self.incident is None:
            return self._prepare(time)
        if self.incident.state is State.RETURNING:
            return self._end(time, f"{self.incident.detail} The substitute has stopped.")
        if self.incident.state is State.UNHEALED:
            self._tried.clear()
            return self._heal(time)
        limit = self._world.settings.start_timeout
        return self._substitute_failed(time, f"no message within {limit:g} s", True)

    def close(self, time: float, why: str) -> List[Command]:
        """The topic is no longer healed: stop the substitute and end the incident."""
        commands = self._drop_substitute()
        return commands + self._end(time, why) if self.incident else commands

    def _open(self, event: FailureSeen, node: str) -> List[Command]:
        self._tried.clear()
        self._deaths = self._pauses = 0
        self.incident = Incident(
            id=self._world.new_incident(),
            topic=self.topic,
            properties=self._world.properties(self.topic),
            faulty_node=node,
            kind=event.kind,
            detail=event.detail,
            detected=event.time,
            last_good=event.last_good,
        )
        text = f"{self.topic} failed: {event.detail}. Killing {node}."
        return [Say("warn", text), ShowIncident(self.incident), *self._heal(event.time)]

    def _heal(self, time: float) -> List[Command]:
        """Find a plan, and set a process to work on it: the one at hand, else another."""
        assert self.incident is not None
        try:
            plan = self._prepared_plan() or self._world.plan(self.topic, self._tried)
        except ShsaError as none:
            return self._give_up(time, none)
        switched = bool(self.node) and self.incident.state is State.HEALED
        using = ", ".join(plan.relations) or "the same property elsewhere"
        text = (
            f"{self.topic}: found a substitute of quality {plan.quality:.2g} "
            f"by {using} from {', '.join(plan.program.inputs)}."
        )
        commands = [*self._use(time, plan), Say("info", text)]
        if not switched:
            self._deadline = time + self._world.settings.start_timeout
            commands += self._step(state=State.HEALING, first_message=None)
        return commands + self._step(
            detail=text,
            substitute=self.node,
            inputs=plan.program.inputs,
            code=plan.program.code,
            outputs=plan.program.outputs,
            relations=plan.relations,
            quality=plan.quality,
            missing=(),
        )

    def _prepared_plan(self) -> Optional[TopicPlan]:
        """The plan that the substitute computes already, if it still holds."""
        if self.plan is None or self.plan in self._tried or not self._world.usable(self.plan):
            return None
        return self.plan

    def _use(self, time: float, plan: TopicPlan) -> List[Command]:
        self.plan = plan
        self._assigned = time
        if self.node:
            return [AssignSubstitute(self.node)]
        self.node, command = self._world.process(self.topic, plan.program)
        return [command]

    def _prepare(self, time: float) -> List[Command]:
        """Without an incident: keep the substitute of a hot topic on the best plan."""
        if not self._world.hot(self.topic) or self._deadline is not None:
            return []
        try:
            plan = self._world.plan_ahead(self.topic)
        except ShsaError:
            return self._drop_substitute()
        return [] if plan == self.plan else self._use(time, plan)

    def _substitute_failed(self, time: float, why: str, tried: bool) -> List[Command]:
        """Stop the substitute, and heal with the next best.

        Its plan counts as tried at once if `tried`; else after it died more than `restarts` times.
        """
        if self.plan is None:
            return []
        self._deaths += 1
        if tried or self._deaths > self._world.settings.restarts:
            self._tried.add(self.plan)
            self._deaths = 0
        commands = self._drop_substitute()
        commands.append(Say("warn", f"{self.topic}: the substitute failed: {why}."))
        if self.incident is None:
            self._deadline = time + self._pause()
            return commands
        if self.incident.state is State.RETURNING:
            return commands + self._step(substitute="")
        return commands + self._heal(time)

    def _give_up(self, time: float, none: ShsaError) -> List[Command]:
        """Nothing can substitute: say what is missing, and try again later."""
        assert self.incident is not None
        due = self._deadline if self.incident.state is State.UNHEALED else None
        commands = self._drop_substitute()
        self._deadline = time + self._pause() if due is None else due
        missing = none.missing if isinstance(none, NoSubstitute) else ()
        if self.incident.state is State.UNHEALED and self.incident.missing == missing:
            return commands
        text = f"{self.topic} cannot be healed now: {none}."
        commands.append(Say("error", text))
        return commands + self._step(
            state=State.UNHEALED,
            detail=text,
            missing=missing,
            substitute="",
            inputs=(),
            code="",
            outputs=(),
            relations=(),
            quality=0.0,
        )

    def _pause(self) -> float:
        """How long to wait before the next try, in s."""
        settings = self._world.settings
        self._pauses += 1
        return min(settings.retry * 2.0 ** (self._pauses - 1), settings.retry_limit)

    def _notice_first_message(self) -> List[Command]:
        assert self.incident is not None
        row = self._world.publisher(self.topic, self.node) if self.node else None
        if self.incident.state is not State.HEALING or row is None or row.state != "healthy":
            return []
        # A process that only changed its program spoke before: then it has recovered since.
        moments = (row.first_message, row.since)
        first = next((t for t in moments if t is not None and t >= self._assigned), None)
        if first is None:
            return []
        self._deadline = None
        commands = self._step(state=State.HEALED, first_message=first)
        outage = self.incident.outage
        lasted = "" if outage is None else f" The outage lasted {outage:.3f} s."
        return [*commands, Say("info", f"{self.topic}: {self.node} publishes it now.{lasted}")]

    def _notice_return(self, time: float) -> List[Command]:
        assert self.incident is not None
        incident = self.incident
        if incident.state is State.RETURNING or self._world.dying(incident.faulty_node):
            return []
        failed_at = incident.detected if incident.killed is None else incident.killed
        for row in self._world.originals(self.topic):
            if row.state == "healthy" and row.since > failed_at:
                hold_off = self._world.settings.hold_off
                self._deadline = time + hold_off
                text = f"{self.topic}: {row.publisher} is back."
                said = Say("info", f"{text} It must stay healthy for {hold_off:g} s.")
                return [
                    said,
                    *self._step(state=State.RETURNING, returned=row.since, detail=text),
                ]
        return []

    def _end(self, time: float, why: str) -> List[Command]:
        commands = [] if self._world.hot(self.topic) else self._drop_substitute()
        commands += self._step(state=State.ENDED, ended=time, detail=why)
        self.incident = None
        self._deadline = None
        self._pauses = 0
        return [*commands, Say("info", why), *self._prepare(time)]

    def _drop_substitute(self) -> List[Command]:
        commands: List[Command] = [StopSubstitute(self.node)] if self.node else []
        self.node = ""
        self.plan = None
        self._deadline = None
        return commands

    def _step(self, **changes: object) -> List[Command]:
        assert self.incident is not None
        self.incident = replace(self.incident, **changes)  # type: ignore[arg-type]
        return [ShowIncident(self.incident)]

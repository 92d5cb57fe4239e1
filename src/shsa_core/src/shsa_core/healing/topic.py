"""The healing of one topic: a state machine, fed by the reconfigurator."""
from dataclasses import replace
from typing import List, Optional

from shsa_core.codegen.generator import Program
from shsa_core.errors import NoSubstitute, ShsaError
from shsa_core.healing.events import (
    Command,
    FailureSeen,
    NodeKilled,
    RunCommand,
    Say,
    ShowIncident,
    SubstituteStarted,
    Substitution,
)
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.revival import Revival
from shsa_core.healing.stand_in import StandIn
from shsa_core.healing.world import World
from shsa_core.model.checks import NODE_GONE, SILENT
from shsa_core.model.policies import RESTART, Intensity

SUBSTITUTED = (State.HEALING, State.HEALED)
STUCK = (State.UNHEALED, State.SAFE)
NOTHING = Program((), "", ())
CHANGEOVER = 1.0  # s after a change of program in which silence is no failure yet


class Healing:
    """The healing of one topic: at most one open incident, at most one substitute.

    A hot topic has its substitute before the incident and keeps it after: mute, and computing.
    """

    def __init__(self, topic: str, world: World) -> None:
        self.topic = topic
        self.incident: Optional[Incident] = None
        self._world = world
        self._stand_in = StandIn(topic, world)
        self._certainly_gone = False
        self._pauses = 0
        self._deadline: Optional[float] = None
        self._revival = Revival(topic, world)
        self._intensity = Intensity(world.settings.healings)

    @property
    def node(self) -> str:
        """The substitute's node name; empty without one."""
        return self._stand_in.node

    @property
    def open(self) -> bool:
        """Whether an incident is open."""
        return self.incident is not None

    @property
    def deadline(self) -> Optional[float]:
        """When `tick` has something to do, in s; None: nothing is due."""
        dues = (self._deadline, self._revival.deadline)
        return min((due for due in dues if due is not None), default=None)

    @property
    def substitution(self) -> Optional[Substitution]:
        """The row of this topic in the table of substitutions; None without a substitute.

        A substitute speaks only when the faulty node is gone and the original is not back: one voice.
        """
        incident = self.incident
        original = incident.faulty_node if incident and incident.killed else ""
        return self._stand_in.row(self._speaking(incident), original)

    @property
    def _kept_out(self) -> bool:
        """Whether the original may not return."""
        return self._revival.kept_out or self._intensity.exceeded

    def _speaking(self, incident: Optional[Incident]) -> bool:
        if incident is None or incident.state not in (*SUBSTITUTED, State.SAFE):
            return False
        return self._certainly_gone or not self._world.dying(incident.faulty_node)

    def failed(self, event: FailureSeen) -> List[Command]:
        """A publisher of the topic failed: kill it, and heal unless another original carries on."""
        if self.node and event.publisher == self.node:
            return self._own_failed(event)
        node = event.publisher or self._world.provider(self.topic)
        leaving = event.kind == NODE_GONE and self._world.dying(node)
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
        if leaving and node == self.incident.faulty_node:
            self._certainly_gone = True  # its process may take a while longer, but has no voice
            return commands
        text = f"{self.topic}: {node} failed again: {event.detail}."
        commands.append(Say("warn", text))
        if self.incident.state is not State.RETURNING:
            return commands
        self._certainly_gone = event.kind == NODE_GONE
        self._deadline = None
        self._revival.failed_again()
        if self._revival.kept_out:
            text = f"{self.topic}: {node} keeps failing. It is kept out until it is released."
            commands.append(Say("error", text))
        healed = self._stand_in.substitutes
        commands += self._step(
            state=State.HEALED if healed else State.HEALING,
            faulty_node=node,
            killed=None,
            returned=None,
            detail=text,
        )
        return commands if healed else commands + self._heal(event.time)

    def _own_failed(self, event: FailureSeen) -> List[Command]:
        """Our substitute failed, or fell silent while it changes its program."""
        if self.incident is not None and event.last_good is not None:
            self.incident = replace(self.incident, last_good=event.last_good)
        if event.kind == SILENT and event.time < self._stand_in.assigned + CHANGEOVER:
            if self.incident is not None and self.incident.state is State.SAFE:
                return []
            self._deadline = self._stand_in.assigned + self._stand_in.patience
            return self._step(state=State.HEALING, first_message=None) if self.incident else []
        return self._substitute_failed(event.time, event.detail, event.kind != NODE_GONE)

    def killed(self, event: NodeKilled) -> List[Command]:
        """A faulty node is gone, or cannot be reached to make sure."""
        if self.incident is None or self.incident.faulty_node != event.node:
            return []
        if event.certain:
            if self.incident.state is not State.RETURNING and not self._kept_out:
                self._revival.gone(event.time)
            return [*self._step(killed=event.time), *self._notice_exhaustion(event.time)]
        self._revival.give_up()  # two nodes of one name would end each other
        text = f"{self.topic}: {event.node} may still be running: {event.detail}."
        commands = [Say("error", text), *self._step(detail=text)]
        return commands + self._notice_exhaustion(event.time)

    def restart_failed(self, time: float, node: str, detail: str) -> List[Command]:
        """The faulty node could not be started again."""
        if self.incident is None or self.incident.faulty_node != node:
            return []
        self._revival.gone(time)
        text = f"{self.topic}: {node} cannot be started again: {detail}."
        return [Say("error", text), *self._notice_exhaustion(time)]

    def released(self, time: float) -> List[Command]:
        """What is kept out may return, and what was given up is tried again."""
        self._revival.trust()
        self._intensity.forget()
        if self.incident is None:
            return []
        commands = self._step()
        return commands + (self._heal(time) if self.incident.state in STUCK else [])

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
        if self.incident.state in SUBSTITUTED:
            if not self._stand_in.usable:
                commands.append(Say("warn", f"{self.topic}: the substitute lost an input."))
                commands += self._heal(time)
        elif self.incident.state in STUCK:
            commands += self._heal(time)
        return commands

    def tick(self, time: float) -> List[Command]:
        """Time passed: the substitute is late, the hold-off is over, or a new try is due."""
        commands = self._revival.tick(time, self.incident.faulty_node) if self.incident else []
        if self._deadline is not None and time >= self._deadline:
            self._deadline = None
            commands += self._overdue(time)
        return commands

    def _overdue(self, time: float) -> List[Command]:
        if self.incident is None:
            return self._prepare(time)
        if self.incident.state is State.RETURNING:
            stopped = " The substitute has stopped." if self.node else ""
            return self._end(time, self.incident.detail + stopped)
        if self.incident.state in STUCK:
            self._stand_in.forget()
            return self._heal(time)
        why = f"no message within {self._stand_in.patience:g} s"
        return self._substitute_failed(time, why, self._stand_in.plan_to_blame)

    def close(self, time: float, why: str) -> List[Command]:
        """The topic is no longer healed: stop the substitute and end the incident."""
        self._deadline = None
        commands = self._stand_in.drop()
        return commands + self._end(time, why) if self.incident else commands

    def _open(self, event: FailureSeen, node: str) -> List[Command]:
        self._stand_in.forget()
        self._pauses = 0
        self._revival.failed(event.time)
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
        if self._world.policy(self.topic) == RESTART:
            return self._notice_exhaustion(time)
        try:
            self._refuse_too_often()
            plan = self._stand_in.find()
            self._intensity.healed(time)
            self._refuse_too_often()
        except ShsaError as none:
            return self._give_up(time, none)
        speaks = bool(self.node) and self.incident.state in (State.HEALED, State.SAFE)
        using = ", ".join(plan.relations) or "the same property elsewhere"
        text = (
            f"{self.topic}: found a substitute of quality {plan.quality:.2g} "
            f"by {using} from {', '.join(plan.program.inputs)}."
        )
        commands = [*self._stand_in.use(time, plan, speaks), Say("info", text)]
        if speaks:
            self._deadline = None
            state, first_message = State.HEALED, self.incident.first_message
        else:
            self._deadline = time + self._stand_in.patience
            state, first_message = State.HEALING, None
        return commands + self._step(
            state=state,
            first_message=first_message,
            detail=text,
            substitute=self.node,
            inputs=plan.program.inputs,
            code=plan.program.code,
            outputs=plan.program.outputs,
            relations=plan.relations,
            quality=plan.quality,
            missing=(),
        )

    def _prepare(self, time: float) -> List[Command]:
        """Without an incident: keep the substitute of a hot topic on the best plan."""
        if not self._world.hot(self.topic) or self._deadline is not None:
            return []
        return self._stand_in.prepare(time)

    def _substitute_failed(self, time: float, why: str, tried: bool) -> List[Command]:
        """Stop the substitute, and heal with the next best; its plan is not tried again if `tried`."""
        if not self.node:
            return []
        commands = self._stand_in.failed(tried)
        commands.append(Say("warn", f"{self.topic}: the substitute failed: {why}."))
        if self.incident is None:
            self._deadline = time + self._pause()
            return commands
        if self.incident.state is State.RETURNING:
            return commands + self._step(substitute="")
        self._deadline = None
        return commands + self._heal(time)

    def _give_up(self, time: float, none: ShsaError) -> List[Command]:
        """Nothing can substitute: say what is missing, and try again later."""
        assert self.incident is not None
        stuck = self.incident.state in STUCK
        due = self._deadline if stuck else None
        commands = self._stand_in.use_safe_values(time)
        self._deadline = time + self._pause() if due is None else due
        self._revival.trust()  # a node that keeps failing is better than none
        missing = none.missing if isinstance(none, NoSubstitute) else ()
        words = self._world.command(self.topic)
        plan = self._stand_in.plan
        state = State.SAFE if plan or words else State.UNHEALED
        told = (self.incident.state, self.incident.missing, self.incident.substitute)
        if told == (state, missing, self.node):
            return commands
        text = f"{self.topic} cannot be healed now: {none}."
        if plan:
            text += " Its safe value is published."
        if words and not stuck:
            commands.append(RunCommand(self.topic, words))
        program = plan.program if plan else NOTHING
        commands.append(Say("error", text))
        return commands + self._step(
            state=state,
            detail=text,
            missing=missing,
            substitute=self.node,
            inputs=(),
            code=program.code,
            outputs=program.outputs,
            relations=(),
            quality=0.0,
        )

    def _refuse_too_often(self) -> None:
        """Raises ShsaError if the topic was healed too often lately."""
        if self._intensity.exceeded:
            most = self._intensity.most
            raise ShsaError(f"it was healed {most} times within a minute, and must be released")

    def _notice_exhaustion(self, time: float) -> List[Command]:
        """If the node's start is all that could heal the topic and was tried in vain, give up."""
        if self._world.policy(self.topic) != RESTART or not self._revival.exhausted:
            return []
        assert self.incident is not None
        node, count = self.incident.faulty_node, self._revival.restarts
        return self._give_up(time, ShsaError(f"{node} was started again {count} times in vain"))

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
        first = next((t for t in moments if t is not None and t >= self._stand_in.assigned), None)
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
                if self._kept_out and row.publisher == incident.faulty_node:
                    self._certainly_gone = False
                    return self._world.kill(row.publisher, urgent=True)
                self._revival.cancel()
                hold_off = self._revival.hold_off
                self._deadline = time + hold_off
                text = f"{self.topic}: {row.publisher} is back."
                said = Say("info", f"{text} It must stay healthy for {hold_off:g} s.")
                return [
                    said,
                    *self._step(state=State.RETURNING, returned=row.since, detail=text),
                ]
        return []

    def _end(self, time: float, why: str) -> List[Command]:
        commands = [] if self._world.hot(self.topic) else self._stand_in.drop()
        commands += self._step(state=State.ENDED, ended=time, detail=why)
        self.incident = None
        self._deadline = None
        self._pauses = 0
        self._revival.well(time)
        return [*commands, Say("info", why), *self._prepare(time)]

    def _step(self, **changes: object) -> List[Command]:
        assert self.incident is not None
        changes.update(restarts=self._revival.restarts, kept_out=self._kept_out)
        self.incident = replace(self.incident, **changes)  # type: ignore[arg-type]
        return [ShowIncident(self.incident)]

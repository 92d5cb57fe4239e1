"""What is done when the state of a service changes: the actions of the table in `transitions`."""
from dataclasses import replace
from typing import Dict, List, Optional

from shsa_core.codegen.generator import Program
from shsa_core.errors import NoSubstitute, ShsaError
from shsa_core.healing.events import (
    FailureSeen,
    Level,
    Log,
    RunCommand,
    ShowIncident,
)
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.node_return import NodeReturn
from shsa_core.healing.rate_limit import HealingRateLimit
from shsa_core.healing.settings import Settings
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.substitute_process import SubstituteProcess
from shsa_core.healing.transitions import Story, Trigger
from shsa_core.model.kinds import Kind
from shsa_core.monitoring.events import PublisherState

STUCK = (State.UNHEALED, State.SAFE)
NOTHING = Program((), "", ())


class Repair:
    """At most one open incident of one service, and at most one substitute.

    A method for each row of the table.

    Each method is told how things stand, and says what is to be done.
    """

    def __init__(self, service: str, settings: Settings) -> None:
        self.service = service
        self.incident: Optional[Incident] = None
        self.substitute = SubstituteProcess()
        self._settings = settings
        self._may_publish = False  # the faulty node: its kill is not over
        self._pauses = 0
        self._timers: Dict[Trigger, float] = {}
        self._return = NodeReturn(settings)
        self._limit = HealingRateLimit(settings.healings)
        self._story = Story(service)

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

    def _open(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        self._may_publish = event.kind is not Kind.NODE_GONE
        self._timers.clear()
        self.substitute.forget()
        self.substitute.begin(now.time)
        self._pauses = 0
        self._return.failed(event.time)
        self.incident = Incident(
            id=now.incident,
            service=self.service,
            topic=now.service.topic,
            properties=now.service.properties,
            faulty_node=event.publisher,
            kind=event.kind,
            detail=event.detail,
            detected=event.time,
            last_good=event.last_good,
        )
        killing = f" Killing {event.publisher}." if self._may_publish else ""
        text = f"{now.service.topic} failed: {event.detail.rstrip('.')}.{killing}"
        return [Log(Level.WARN, text), ShowIncident(self.incident), *self._heal(now)]

    def _still_failing(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        assert self.incident is not None
        if event.publisher == self.incident.faulty_node:
            self._may_publish = event.kind is not Kind.NODE_GONE
        text = f"{now.service.topic}: {event.publisher} failed again: {event.detail}."
        return [Log(Level.WARN, text)]

    def _failed_again(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        requests = self._still_failing(now, event)
        self._may_publish = event.kind is not Kind.NODE_GONE
        self._timers.clear()
        self._return.failed_again()
        detail = f"{event.publisher} failed again: {event.detail}"
        if self._return.kept_out:
            detail = f"{event.publisher} keeps failing. It is kept out until it is released."
            requests.append(Log(Level.ERROR, f"{now.service.topic}: {detail}"))
        healed = self.substitute.computes
        requests += self._step(
            state=State.HEALED if healed else State.HEALING,
            faulty_node=event.publisher,
            killed=None,
            returned=None,
            detail=detail,
        )
        if healed:
            return requests
        self.substitute.begin(now.time)
        return requests + self._heal(now)

    def _await_again(self, now: Snapshot) -> List[Request]:
        self._timers[Trigger.LATE] = now.time + self.substitute.patience
        self.substitute.begin(now.time)
        return self._step(state=State.HEALING, first_message=None)

    def _replace(self, now: Snapshot) -> List[Request]:
        self._timers.clear()
        return self._heal(now)

    def _replace_late(self, now: Snapshot) -> List[Request]:
        """Its first message has not come: the process is replaced.

        The next best plan is taken if the plan is to blame.
        """
        if self.node not in now.publishers and self.substitute.starting(now.time):
            # It is not up yet: another process would only make the machine busier.
            self._timers[Trigger.LATE] = now.time + self.substitute.patience
            return []
        why = f"no message within {self.substitute.patience:.1f} s"
        text = f"{now.service.topic}: the substitute failed: {why}."
        blamed = self.substitute.plan_to_blame
        return [*self.substitute.failed(now, blamed), Log(Level.WARN, text), *self._heal(now)]

    def _change_inputs(self, now: Snapshot) -> List[Request]:
        text = f"{now.service.topic}: the substitute lost an input."
        return [Log(Level.WARN, text), *self._heal(now)]

    def _retry(self, now: Snapshot) -> List[Request]:
        self.substitute.forget()
        return self._heal(now)

    def _heal(self, now: Snapshot) -> List[Request]:
        """Find a plan, and set a process to work on it: the one at hand, else another."""
        assert self.incident is not None
        if not now.service.policy.substitutes:
            return self._wait_for_node(now)
        try:
            self._refuse_too_often()
            plan = self.substitute.find(now, self.incident.faulty_node)
            self._limit.healed(now.time)
            self._refuse_too_often()
        except ShsaError as none:
            return self._give_up(now, none)
        publishes = bool(self.node) and self.incident.state in (State.HEALED, State.SAFE)
        using = ", ".join(plan.relations) or "the same property elsewhere"
        text = (
            f"{now.service.topic}: found a substitute of quality {plan.quality:.2g} "
            f"by {using} from {', '.join(plan.program.inputs) or 'constants'}."
        )
        requests: List[Request] = [
            *self.substitute.use(now, plan, publishes),
            Log(Level.INFO, text),
        ]
        self._timers.clear()
        state, first_message = State.HEALED, self.incident.first_message
        if not publishes:
            self._timers[Trigger.LATE] = now.time + self.substitute.patience
            state, first_message = State.HEALING, None
        return requests + self._step(
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

    def _prepare(self, now: Snapshot) -> List[Request]:
        """Without an incident: keep the substitute of a hot service on the best plan."""
        return [*(self.substitute.prepare(now) if now.hot else self.substitute.drop())]

    def _pause_standby(self, now: Snapshot) -> List[Request]:
        self._timers[Trigger.RETRY] = now.time + self._pause()
        return []

    def _lose_standby(self, now: Snapshot) -> List[Request]:
        return self._step(substitute="")

    def _record(self, now: Snapshot) -> List[Request]:
        return self._step()

    def _give_up(self, now: Snapshot, none: ShsaError) -> List[Request]:
        """Nothing can substitute: say what is missing, and try again later."""
        assert self.incident is not None
        stuck = self.incident.state in STUCK
        due = self._timers.get(Trigger.RETRY) if stuck else None
        requests: List[Request] = [*self.substitute.use_safe_values(now)]
        self._timers.clear()
        self._timers[Trigger.RETRY] = now.time + self._pause() if due is None else due
        self._return.trust()  # a node that keeps failing is better than none
        missing = none.missing if isinstance(none, NoSubstitute) else ()
        words = now.service.last_resort.command
        plan = self.substitute.plan
        state = State.SAFE if plan or words else State.UNHEALED
        told = (self.incident.state, self.incident.missing, self.incident.substitute)
        if told == (state, missing, self.node):
            return requests
        text = f"{now.service.topic} cannot be healed now: {none}."
        if plan:
            text += " Its safe values are published."
        if words and not stuck:
            requests.append(RunCommand(self.service, words))
        program = plan.program if plan else NOTHING
        requests.append(Log(Level.ERROR, text))
        return requests + self._step(
            state=state,
            detail=text,
            missing=missing,
            substitute=self.node,
            inputs=(),
            code=program.code,
            outputs=program.outputs,
            relations=(),
            quality=None,
        )

    def _refuse_too_often(self) -> None:
        """Raises ShsaError if the service was healed too often lately."""
        if self._limit.exceeded:
            most = self._limit.most
            raise ShsaError(f"it was healed {most} times within a minute, and must be released")

    def _wait_for_node(self, now: Snapshot) -> List[Request]:
        """The node's start is all that can heal the service: give up if it was tried in vain."""
        assert self.incident is not None
        if self.incident.killed is not None and self._return.deadline is None:
            self._return.gone(now)  # the policy may have been another one when it was killed
        if self._return.exhausted:
            return self._exhausted(now)
        if self.incident.substitute and not self.node:
            return self._step(state=State.HEALING, substitute="")
        if self.state in STUCK:
            self._timers.setdefault(Trigger.RETRY, now.time + self._pause())
        return []

    def _exhausted(self, now: Snapshot) -> List[Request]:
        assert self.incident is not None
        node, count = self.incident.faulty_node, self._return.restarts
        return self._give_up(now, ShsaError(f"{node} was started again {count} times in vain"))

    def _pause(self) -> float:
        """How long to wait before the next try, in s."""
        self._pauses += 1
        longest = self._settings.retry_limit
        return min(self._settings.retry * 2.0 ** (self._pauses - 1), longest)

    def _first_message(self, now: Snapshot) -> Optional[float]:
        """When the substitute published first in this takeover, or had recovered."""
        row = now.publishers[self.node]
        moments = (row.first_message, row.since)
        since = self.substitute.working_since
        return next((moment for moment in moments if moment is not None and moment >= since), None)

    def _publishes(self, now: Snapshot) -> List[Request]:
        assert self.incident is not None
        self._timers.clear()
        requests = self._step(state=State.HEALED, first_message=self._first_message(now))
        outage = self.incident.outage
        lasted = "" if outage is None else f" The outage lasted {outage:.3f} s."
        text = f"{now.service.topic}: {self.node} publishes it now.{lasted}"
        return [*requests, Log(Level.INFO, text)]

    def _hold_off(self, now: Snapshot) -> List[Request]:
        assert self.incident is not None
        incident = self.incident
        failed_at = incident.detected if incident.killed is None else incident.killed
        row = next(
            row
            for row in now.originals
            if row.state is PublisherState.HEALTHY and row.since > failed_at
        )
        self._return.cancel()
        hold_off = self._return.hold_off
        self._timers.clear()
        self._timers[Trigger.STEADY] = now.time + hold_off
        text = f"{incident.topic}: {row.publisher} is back."
        said = Log(Level.INFO, f"{text} It must stay healthy for {hold_off:g} s.")
        return [said, *self._step(state=State.RETURNING, returned=row.since, detail=text)]

    def _end(self, now: Snapshot) -> List[Request]:
        assert self.incident is not None
        stopped = " The substitute has stopped." if self.node and not now.hot else ""
        requests: List[Request] = [] if now.hot else [*self.substitute.drop()]
        return requests + self._close(now, self.incident.detail + stopped) + self._prepare(now)

    def _withdraw(self, now: Snapshot) -> List[Request]:
        why = f"{self.service} is not in the SOM any more."
        return [*self.substitute.drop(), *self._close(now, why)]

    def _close(self, now: Snapshot, why: str) -> List[Request]:
        requests = self._step(state=State.ENDED, ended=now.time, detail=why)
        self.incident = None
        self._timers.clear()
        self._pauses = 0
        self._return.cancel()
        self._return.well(now.time)
        return [*requests, Log(Level.INFO, why)]

    def _step(self, **changes: object) -> List[Request]:
        assert self.incident is not None
        changes.update(restarts=self._return.restarts, kept_out=self._kept_out)
        self.incident = replace(self.incident, **changes)  # type: ignore[arg-type]
        return [ShowIncident(self.incident)]

"""What is done when the state of a service changes: the actions of the table in `transitions`."""
from typing import List, Optional

from shsa_core.codegen.plans import Plan
from shsa_core.errors import NoSubstitute, ShsaError
from shsa_core.healing.events import (
    FailureSeen,
    Level,
    Log,
    RunCommand,
    ShowIncident,
    StartSubstitute,
)
from shsa_core.healing.faulty_node import FaultyNode
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.judgement import NOTHING, WAITING, Judgement, told
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.transitions import Trigger
from shsa_core.model.kinds import Kind, Standby
from shsa_core.monitoring.events import PublisherState

SAME_S = 0.05
"""Moments within this may be one: they come through the clocks of two processes. So a failure that
is told twice is one, and what a substitute said at that moment was said in its place."""


class Repair(Judgement):
    """A method for each row of the table.

    Each method is told how things stand, and says what is to be done.
    """

    def _open(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        self._timers.clear()
        self.substitute.forget()
        self.substitute.begin(event.time)
        self._pauses = 0
        if event.kind is not Kind.REQUESTED:
            self._return.failed(event.time, not now.by_link(event.kind))
        self._faulty.failed(event.publisher, event.kind)
        self.incident = Incident(
            id=now.incident,
            service=self.service,
            topic=now.service.topic,
            properties=now.service.properties,
            faulty_node=event.publisher,
            kind=event.kind,
            evidence=event.detail,
            detail=event.detail,
            detected=event.time,
            last_good=event.last_good,
        )
        text = f"{now.service.topic} failed: {event.detail.rstrip('.')}."
        requests: List[Request] = [Log(Level.WARN, text), ShowIncident(self.incident)]
        requests += self._heal(now)
        if event.kind is Kind.REQUESTED and self._faulty.kept:
            requests += self._close(now, self.incident.detail)  # it goes on as it was
        return requests

    def _still_failing(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        text = f"{now.service.topic}: {event.publisher} failed again: {event.detail}."
        assert self.incident is not None
        if event.publisher == self.incident.faulty_node:
            self._faulty.failed(event.publisher, event.kind)
            return [Log(Level.WARN, text), *self._judge_again(now)]
        blamed, self._faulty = self._faulty, FaultyNode()
        self._faulty.failed(event.publisher, event.kind)
        requests = [Log(Level.WARN, text), *self._judge(now, self._search(now)[0] is not None)]
        if self._faulty.babbles:
            return requests + self._judge_again(now)
        self._faulty = blamed  # the other one is killed, or silent
        return requests

    def _judge_again(self, now: Snapshot) -> List[Request]:
        """Decide about the node anew: what it costs may have changed."""
        assert self.incident is not None
        if self.incident.state is State.KEPT:
            return self._heal(now)
        plan, none = self._search(now)
        requests = self._judge(now, plan is not None)
        if self._faulty.babbles or self._idle(now):
            return requests + self._keep(now, plan, none)
        return requests + self._step(faulty_node=self._faulty.name) if requests else []

    def _failed_again(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        text = f"{now.service.topic}: {event.publisher} failed again: {event.detail}."
        self._faulty.failed(event.publisher, event.kind)
        self._timers.clear()
        self._return.relapsed(event.time, not now.by_link(event.kind))
        plan, none = self._search(now)
        requests = [Log(Level.WARN, text), *self._judge(now, plan is not None)]
        detail = f"{event.publisher} failed again: {event.detail}"
        if self._return.kept_out and not self._faulty.kept:
            detail = f"{event.publisher} keeps failing. It is kept out until it is released."
            requests.append(Log(Level.ERROR, f"{now.service.topic}: {detail}"))
        healed = self.substitute.computes
        awaited = healed and self._faulty.waits
        if awaited:
            self._timers[Trigger.LATE] = now.time + self.substitute.patience
            self.substitute.begin(event.time)
        requests += self._step(
            state=State.HEALED if healed and not awaited else State.HEALING,
            faulty_node=event.publisher,
            killed=None,
            returned=None,
            detail=detail,
        )
        if self._faulty.babbles or self._idle(now):
            return requests + self._keep(now, plan, none)
        if healed:
            return requests
        self.substitute.begin(event.time)
        return requests + self._heal(now)

    def _await_again(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        """What it has published since it fell silent counts, though that may be heard late."""
        self._timers[Trigger.LATE] = now.time + self.substitute.patience
        self.substitute.begin(event.time)
        return self._step(state=State.HEALING, first_message=None)

    def _replace(self, now: Snapshot) -> List[Request]:
        self._timers.clear()
        return self._heal(now)

    def _replace_late(self, now: Snapshot) -> List[Request]:
        """Its first message has not come: the process is replaced.

        The next best plan is taken if the plan is to blame.
        """
        starting = self.node not in now.publishers and self.substitute.starting(now.time)
        starting = starting and not now.spare(self.substitute.host).heard
        if starting or not now.watched:
            # It is not up yet: a new process would only make the machine busier. Or nobody can say.
            self._timers[Trigger.LATE] = now.time + self.substitute.patience
            return []
        why = f"no message within {self.substitute.patience:.1f} s"
        text = f"{now.service.topic}: the substitute failed: {why}."
        blamed = self.substitute.plan_to_blame
        return [*self.substitute.failed(now, blamed), Log(Level.WARN, text), *self._heal(now)]

    def _change_inputs(self, now: Snapshot) -> List[Request]:
        text = f"{now.service.topic}: the substitute lost an input."
        return [Log(Level.WARN, text), *self._heal(now)]

    def _change_law(self, now: Snapshot) -> List[Request]:
        """The substitute says that its law does not hold now: follow the next one, if there is one.

        Before an incident, the better law is looked at again after a while.
        """
        faulty = self.incident.faulty_node if self.incident else now.service.node
        another = self.substitute.another(now, faulty)
        text = f"{now.service.topic}: the substitute's law does not hold now"
        if another is None:
            return [Log(Level.WARN, f"{text}, and there is no other.")]
        said = Log(Level.WARN, f"{text}. The next best takes its place.")
        if self.incident is not None:
            self.substitute.leave_plan()
            return [said, *self._heal(now)]
        self._timers[Trigger.RETRY] = now.time + self._settings.retry_limit
        return [*self.substitute.use(now, another), said]

    def _retry(self, now: Snapshot) -> List[Request]:
        self.substitute.forget()
        return self._heal(now)

    def _heal(self, now: Snapshot) -> List[Request]:
        """Search, decide about the node, and set a process to work: the one at hand, or another."""
        assert self.incident is not None
        plan, none = self._search(now)
        requests = self._judge(now, plan is not None)
        if self._faulty.babbles or self._idle(now):
            return requests + self._keep(now, plan, none)
        if not now.service.policy.substitutes:
            return requests + self._wait_for_node(now)
        if plan is None:
            self._limit.exceeded = self._limit.reached(now.time)
            return requests + self._give_up(now, none)
        return requests + self._follow(now, plan)

    def _follow(self, now: Snapshot, plan: Plan) -> List[Request]:
        """Set a process to work on a plan."""
        assert self.incident is not None
        if not now.by_link(self._faulty.kind):
            self._limit.healed(now.time)
        if self.incident.state is State.KEPT:
            self.substitute.begin(now.time)
        publishes = bool(self.node) and self.incident.state in (State.HEALED, State.SAFE)
        text = f"{now.service.topic}: found a substitute of {told(plan)}."
        place = self.substitute.place(now, plan)
        requests: List[Request] = [*self.substitute.use(now, plan, publishes)]
        if now.service.standby is Standby.WARM and isinstance(requests[0], StartSubstitute):
            text += " No idle process is left: this is a cold start."
        text += place.words
        requests.append(Log(Level.INFO, text))
        self._timers.clear()
        state, first_message = State.HEALED, self.incident.first_message
        if not publishes:
            self._timers[Trigger.LATE] = now.time + self.substitute.patience
            state, first_message = State.HEALING, None
        calibrated = now.planner.outputs(plan)
        return requests + self._step(
            state=state,
            first_message=first_message,
            detail=text,
            substitute=self.node,
            inputs=plan.program.inputs,
            code=plan.program.code,
            outputs=plan.program.outputs,
            relations=plan.relations,
            gains=tuple(each.gain for each in calibrated),
            offsets=tuple(each.offset for each in calibrated),
            quality=plan.quality,
            errors=tuple(each.error for each in calibrated),
            missing=(),
            unavailable=now.planner.unavailable(self.service),
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
        stuck = self.incident.state in WAITING
        due = self._timers.get(Trigger.RETRY) if stuck else None
        requests: List[Request] = [*self.substitute.use_safe_values(now)]
        self._timers.clear()
        self._timers[Trigger.RETRY] = now.time + self._pause() if due is None else due
        self._return.trust()  # a node that keeps failing is better than none
        missing = none.missing if isinstance(none, NoSubstitute) else ()
        words = now.service.last_resort.command
        plan = self.substitute.plan
        state = State.SAFE if plan or words else State.UNHEALED
        decision = self.incident.decision
        before = (self.incident.state, self.incident.missing, self.incident.substitute, decision)
        if before == (state, missing, self.node, self._faulty.decision):
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
            unavailable=now.planner.unavailable(self.service),
            substitute=self.node,
            inputs=(),
            code=program.code,
            outputs=program.outputs,
            relations=(),
            gains=(),
            offsets=(),
            quality=None,
            errors=(),
        )

    def _wait_for_node(self, now: Snapshot) -> List[Request]:
        """The node's start is all that can heal the service: give up if it was tried in vain."""
        assert self.incident is not None
        if self.incident.killed is not None and self._return.deadline is None:
            self._return.gone(now)  # the policy may have been another one when it was killed
        if self._return.exhausted:
            return self._exhausted(now)
        if self.incident.substitute and not self.node:
            return self._step(state=State.HEALING, substitute="")
        if self.state in WAITING:
            self._timers.setdefault(Trigger.RETRY, now.time + self._pause())
        return []

    def _exhausted(self, now: Snapshot) -> List[Request]:
        assert self.incident is not None
        node, count = self.incident.faulty_node, self._return.restarts
        return self._give_up(now, ShsaError(f"{node} was started again {count} times in vain"))

    def _first_message(self, now: Snapshot) -> Optional[float]:
        """When the substitute published first in this takeover, or had recovered."""
        row = now.publishers[self.node]
        moments = (row.first_message, row.since)
        least = self.substitute.working_since - SAME_S
        return next((moment for moment in moments if moment is not None and moment >= least), None)

    def _publishes(self, now: Snapshot) -> List[Request]:
        assert self.incident is not None
        self._timers.clear()
        requests = self._step(state=State.HEALED, first_message=self._first_message(now))
        outage = self.incident.outage
        lasted = "" if outage is None else f" The outage lasted {outage:.3f} s."
        text = f"{now.service.topic}: {self.node} publishes it now.{lasted}"
        requests.append(Log(Level.INFO, text))
        if self._faulty.waits:
            requests += self._judge(now, replaced=True) + self._step()
        return requests

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
        self._return.returned(row.since)
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
        self.last_message = b""
        self._timers.clear()
        self._pauses = 0
        self._return.cancel()
        self._return.well(now.time)
        return [*requests, Log(Level.INFO, why)]

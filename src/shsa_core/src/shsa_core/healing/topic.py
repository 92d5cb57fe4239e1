"""The healing of one service: a state machine, fed by the reconfigurator."""
from dataclasses import replace
from typing import List, Optional

from shsa_core.errors import ShsaError
from shsa_core.healing.events import FailureSeen, Level, Log, SubstituteStarted
from shsa_core.healing.incident import State
from shsa_core.healing.kills import KillNode, NodeKilled
from shsa_core.healing.repair import STUCK, Repair
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.transitions import Trigger
from shsa_core.model.kinds import Kind
from shsa_core.monitoring.events import PublisherState

SUBSTITUTED = (State.HEALING, State.HEALED)
PUBLISHED = (*SUBSTITUTED, State.SAFE)


class TopicHealing(Repair):
    """The healing of one service: makes triggers of what happens.

    A hot service has its substitute before the incident and keeps it after: muted, and computing.
    """

    @property
    def deadline(self) -> Optional[float]:
        """When `tick` has something to do, in s; None: nothing is due."""
        dues = [*self._timers.values()]
        if self._return.deadline is not None:
            dues.append(self._return.deadline)
        return min(dues, default=None)

    @property
    def original(self) -> str:
        """The node that the substitute stands in for, once that is gone; empty before."""
        return self.incident.faulty_node if self.incident and self.incident.killed else ""

    @property
    def publishes(self) -> bool:
        """Whether the substitute publishes.

        It does only when the faulty node is gone and the original is not back.
        """
        return self.state in PUBLISHED and not self._may_publish

    def failed(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        """A publisher failed: kill it, and heal unless another original carries on."""
        if self.node and event.publisher == self.node:
            return self._own_failed(now, event)
        node = event.publisher or now.service.node
        gone = event.kind is Kind.NODE_GONE
        if self.incident is not None and node == self.incident.faulty_node:
            if gone and node in now.killing:
                self._may_publish = False  # its process may take a while longer
                return []
            if event.time <= self.incident.detected:
                return []  # told twice
        kill: List[Request] = [KillNode(node, urgent=not gone)]
        if self.incident is None:
            healthy = [
                row.publisher
                for row in now.originals
                if row.state is PublisherState.HEALTHY and row.publisher != node
            ]
            if healthy:
                text = f"{event.topic}: {node} failed ({event.detail}); {healthy[0]} carries on."
                return [*kill, Log(Level.WARN, text)]
        return kill + self._fire(now, Trigger.FAILED, replace(event, publisher=node))

    def killed(self, now: Snapshot, event: NodeKilled) -> List[Request]:
        """A faulty node is gone, or cannot be reached to make sure."""
        assert self.incident is not None and self.incident.faulty_node == event.node
        self._may_publish = False  # for all that can be done
        if event.certain:
            if self.incident.state is not State.RETURNING and not self._kept_out:
                self._return.gone(now)
            return [*self._step(killed=event.time), *self._notice_exhaustion(now)]
        self._return.give_up()  # two nodes of one name would end each other
        text = f"{self.incident.topic}: {event.node} may still be running: {event.detail}."
        said: List[Request] = [Log(Level.ERROR, text), *self._step(detail=text)]
        return said + self._notice_exhaustion(now)

    def restart_failed(self, now: Snapshot, node: str, detail: str) -> List[Request]:
        """The faulty node could not be started again."""
        assert self.incident is not None and self.incident.faulty_node == node
        self._return.gone(now)
        text = f"{self.incident.topic}: {node} cannot be started again: {detail}."
        return [Log(Level.ERROR, text), *self._notice_exhaustion(now)]

    def released(self, now: Snapshot) -> List[Request]:
        """What is kept out may return, and what was given up is tried again."""
        self._return.trust()
        self._limit.forget()
        return self._fire(now, Trigger.RELEASED) if self.incident else []

    def started(self, event: SubstituteStarted) -> List[Request]:
        """The substitute was set to work."""
        return self._step(found=event.found, spawned=event.time) if self.incident else []

    def exited(self, now: Snapshot, detail: str) -> List[Request]:
        """The substitute's process ended."""
        return self._substitute_failed(now, f"its process died ({detail})", False)

    def changed(self, now: Snapshot, service_came: bool = False) -> List[Request]:
        """Health or the SOM changed: a first message, a return, a lost input, a new chance."""
        requests = self._notice_first_message(now) + self._notice_return(now)
        if self.state in SUBSTITUTED and self.substitute.lost_input(now):
            requests += self._fire(now, Trigger.INPUT_LOST)
        elif self.state in STUCK and service_came:
            requests += self._fire(now, Trigger.SERVICE_CAME)
        return requests

    def replan(self, now: Snapshot) -> List[Request]:
        """The plan for a failure of a service may be another one, or its policy."""
        waits = self.state is State.HEALING and not self.node
        well = self.state is State.WELL and Trigger.RETRY not in self._timers
        if not waits and not well:
            return []
        return self._fire(now, Trigger.PREPARE)

    def tick(self, now: Snapshot) -> List[Request]:
        """Time passed: a timer is due."""
        requests: List[Request] = []
        if self.incident is not None:
            requests = self._return.tick(now, self.incident.faulty_node)
        for trigger, due in list(self._timers.items()):
            if now.time >= due and trigger in self._timers:
                del self._timers[trigger]
                requests += self._fire(now, trigger)
        return requests

    def close(self, now: Snapshot) -> List[Request]:
        """The service is no longer healed."""
        if self.incident is not None:
            return self._fire(now, Trigger.WITHDRAWN)
        self._timers.clear()
        return [*self.substitute.drop()]

    def validate(self) -> None:
        """Raises ShsaError if something is not as it must be."""
        if bool(self.node) != (self.substitute.plan is not None):
            raise ShsaError(f"{self.service}: a process without a plan, or the other way round")
        due = {
            State.WELL: {Trigger.RETRY},
            State.HEALING: {Trigger.LATE},
            State.RETURNING: {Trigger.STEADY},
            State.UNHEALED: {Trigger.RETRY},
            State.SAFE: {Trigger.RETRY},
        }.get(self.state, set())
        if not set(self._timers) <= due:
            raise ShsaError(f"{self.service}: {self.state} with the timers {set(self._timers)}")
        if self.state in STUCK and Trigger.RETRY not in self._timers:
            raise ShsaError(f"{self.service}: {self.state}, and nothing will ever be tried again")
        if self.state is State.HEALED and not self.substitute.computes:
            raise ShsaError(f"{self.service}: healed without a substitute")

    def _own_failed(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        """Our substitute failed, or fell silent while it changes its program."""
        changing = event.kind is Kind.SILENT and self.substitute.changing(event.time)
        if changing and self.state not in SUBSTITUTED:
            return []
        if self.incident is not None and event.last_good is not None:
            self.incident = replace(self.incident, last_good=event.last_good)
        if changing:
            return self._fire(now, Trigger.SILENT)
        return self._substitute_failed(now, event.detail, event.kind is not Kind.NODE_GONE)

    def _substitute_failed(self, now: Snapshot, why: str, tried: bool) -> List[Request]:
        """Stop the substitute; its plan is not tried again if `tried`."""
        text = f"{now.service.topic}: the substitute failed: {why}."
        requests: List[Request] = [*self.substitute.failed(now, tried), Log(Level.WARN, text)]
        return requests + self._fire(now, Trigger.SUBSTITUTE_FAILED)

    def _notice_exhaustion(self, now: Snapshot) -> List[Request]:
        waiting = self.state in (State.HEALING, *STUCK)
        if now.service.policy.substitutes or not self._return.exhausted or not waiting:
            return []
        return self._fire(now, Trigger.EXHAUSTED)

    def _notice_first_message(self, now: Snapshot) -> List[Request]:
        row = now.publishers.get(self.node) if self.node else None
        if self.state is not State.HEALING or row is None:
            return []
        if row.state is not PublisherState.HEALTHY or self._first_message(now) is None:
            return []
        return self._fire(now, Trigger.FIRST_MESSAGE)

    def _notice_return(self, now: Snapshot) -> List[Request]:
        incident = self.incident
        if incident is None or incident.state is State.RETURNING:
            return []
        if incident.faulty_node in now.killing:
            return []
        failed_at = incident.detected if incident.killed is None else incident.killed
        for row in now.originals:
            if row.state is PublisherState.HEALTHY and row.since > failed_at:
                if self._kept_out and row.publisher == incident.faulty_node:
                    self._may_publish = True
                    return [KillNode(row.publisher, urgent=True)]
                return self._fire(now, Trigger.RETURNED)
        return []

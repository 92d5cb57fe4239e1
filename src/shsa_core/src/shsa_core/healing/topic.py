"""The healing of one service: a state machine, fed by the reconfigurator."""
import math
from dataclasses import replace
from typing import List, Optional

from shsa_core.errors import ShsaError
from shsa_core.healing.events import FailureSeen, Level, Log, SubstituteStarted
from shsa_core.healing.incident import State
from shsa_core.healing.kills import KillNode, NodeKilled
from shsa_core.healing.judgement import STUCK, WAITING
from shsa_core.healing.repair import SAME_S
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.stranding import Stranding
from shsa_core.healing.transitions import Trigger
from shsa_core.model.kinds import Kind
from shsa_core.monitoring.events import PublisherState

SUBSTITUTED = (State.HEALING, State.HEALED)


class TopicHealing(Stranding):
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
    def refuses(self) -> bool:
        """Whether the faulty node is gone, and may not return."""
        incident = self.incident
        returning = self.state is State.RETURNING
        return bool(incident and self._kept_out and incident.killed and not returning)

    def failed(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        """A publisher failed: decide about it, and heal unless another original carries on."""
        self._note_message(event)
        if self.node and event.publisher == self.node:
            return self._own_failed(now, event)
        node = event.publisher or now.service.node
        gone = event.kind is Kind.NODE_GONE
        if self.incident is not None and node == self.incident.faulty_node:
            returning = self.state is State.RETURNING
            if gone and node in now.killing and not returning:
                self._faulty.heard = False  # its process may take a while longer
                return []
            if self.refuses and (gone or node in now.killing) and not self._faulty.kept:
                return []  # it came back, and is killed for that
            same = SAME_S if event.kind is self.incident.kind else 0.0
            if event.time <= max(self.incident.detected + same, self.incident.killed or -math.inf):
                return []  # told twice: what failed then is known, or gone
        if self.incident is None:
            healthy = [
                row.publisher
                for row in now.originals
                if row.state is PublisherState.HEALTHY and row.publisher not in now.killing | {node}
            ]
            if healthy:
                self._faulty.failed(node, event.kind)
                requests = self._judge(now, replaced=True)
                text = f"{event.topic}: {node} failed ({event.detail}); {healthy[0]} carries on."
                return [*requests, Log(Level.WARN, text)]
        requests = self._fire(now, Trigger.FAILED, replace(event, publisher=node))
        return requests + self._notice_first_message(now)  # by a bridge, heard before the failure

    def came_up(self, now: Snapshot) -> List[Request]:
        """The faulty node is there again, though nobody may have heard it yet."""
        assert self.incident is not None
        node = self.incident.faulty_node
        if not self.refuses or self._faulty.kept or node in now.killing or now.awaited(node):
            return []
        if not now.verdict(node, Kind.OTHER, self.substitute.computes, False).kill:
            return []
        self._return.refusals += 1
        return [KillNode(node, urgent=True, at_once=True, topic=now.service.topic)]

    def killed(self, now: Snapshot, event: NodeKilled) -> List[Request]:
        """A faulty node is gone, or cannot be reached to make sure."""
        assert self.incident is not None and self.incident.faulty_node == event.node
        if not event.certain:
            return self._left_alone(now, f"{event.node} may still be running: {event.detail}")
        self._faulty.gone(certain=True)
        self._return.confirm()
        if event.node != now.service.node:
            self._return.give_up()  # how a stranger was started is not known
        elif self.incident.state is not State.RETURNING and not self._kept_out:
            self._return.gone(now)
        requests = self._refused(now, event.starter) if self._return.refusals else []
        requests += [*self._step(killed=event.time), *self._notice_exhaustion(now)]
        return requests + self.reconsider(now)

    def left_in_order(self) -> List[Request]:
        """The faulty node was told to leave, by somebody else: that is no reason to distrust it."""
        assert self.incident is not None
        if self.incident.kind is not Kind.NODE_GONE:
            return []
        self._return.left_in_order()
        return self._step() if self.incident.kept_out is not self._kept_out else []

    def spared(self, now: Snapshot, detail: str = "") -> List[Request]:
        """A node that was to be cleared if it is dead may still run.

        `detail`: why it is not the one that failed, if it was to be killed.
        """
        if self.incident is not None and detail:
            return self._left_alone(now, f"{self.incident.faulty_node} is left alone: {detail}")
        self._faulty.spared()
        return self._step() if self.incident else []

    def _left_alone(self, now: Snapshot, why: str) -> List[Request]:
        """No more can be done about the faulty node: healing goes on beside it."""
        assert self.incident is not None
        self._faulty.gone()
        if self._return.refusals:
            self._return.trust()  # it cannot be kept out, and two publishers are worse than one
        self._return.give_up()  # two nodes of one name would end each other
        text = f"{self.incident.topic}: {why}."
        said: List[Request] = [Log(Level.ERROR, text), *self._step(detail=text)]
        return said + self._notice_exhaustion(now) + self.reconsider(now)

    def reconsider(self, now: Snapshot) -> List[Request]:
        """What the faulty node costs may be something else now, if it was kept for that."""
        incident = self.incident
        if incident is None or incident.state is State.RETURNING:
            return []
        row = now.publishers.get(incident.faulty_node)
        gone = row is not None and row.kind is Kind.NODE_GONE
        if gone and self._faulty.kept and self._faulty.kind is not Kind.NODE_GONE:
            assert row is not None
            failure = FailureSeen(
                now.time, self.service, row.topic, row.publisher, Kind.NODE_GONE, row.detail
            )
            return self._fire(now, Trigger.FAILED, failure)
        if self._faulty.kept or incident.state is State.KEPT:
            return self._fire(now, Trigger.NODE_CHANGED)
        return []

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

    def process_silent(self, now: Snapshot) -> List[Request]:
        """The substitute's process gives no sign of life: at a takeover another one is at hand."""
        due = self.state is State.HEALING and not self.substitute.plan_to_blame
        return self.process_hung(now) if due else []

    def process_hung(self, now: Snapshot) -> List[Request]:
        """The substitute's process hangs."""
        return self._substitute_failed(now, "its process gives no sign of life", False)

    def changed(self, now: Snapshot, service_came: bool = False) -> List[Request]:
        """Health or the SOM changed: a first message, a return, a lost input, a new chance."""
        self._notice_last_word(now)
        requests = self._notice_first_message(now)
        requests += self._refuse(now) or self._notice_return(now)
        requests += self._resume_kill(now)
        if self.state in SUBSTITUTED and self.substitute.lost_input(now):
            requests += self._fire(now, Trigger.INPUT_LOST)
        elif self.state in STUCK and service_came:
            requests += self._fire(now, Trigger.SERVICE_CAME)
        elif service_came:
            requests += self.reconsider(now)
        return requests

    def replan(self, now: Snapshot) -> List[Request]:
        """The plan for a failure of a service may be another one, or its policy."""
        waits = self.state is State.KEPT or (self.state is State.HEALING and not self.node)
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
            State.HEALING: {Trigger.LATE, Trigger.PREPARE},
            State.RETURNING: {Trigger.STEADY},
            State.UNHEALED: {Trigger.RETRY},
            State.SAFE: {Trigger.RETRY},
            State.KEPT: {Trigger.RETRY},
        }.get(self.state, set())
        if not set(self._timers) <= due:
            raise ShsaError(f"{self.service}: {self.state} with the timers {set(self._timers)}")
        if self.state in WAITING and Trigger.RETRY not in self._timers:
            raise ShsaError(f"{self.service}: {self.state}, and nothing will ever be tried again")
        if self.state is State.HEALED and not self.substitute.computes:
            raise ShsaError(f"{self.service}: healed without a substitute")

    def _note_message(self, event: FailureSeen) -> None:
        """Keep the newest last good message: of the original, or of what was computed for it."""
        good = event.time if event.last_good is None else event.last_good
        safe_values = event.publisher == self.node and not self.substitute.computes
        stranger = event.kind is Kind.UNKNOWN_PUBLISHER
        if event.last_message and good >= self._message_came and not (safe_values or stranger):
            self.last_message, self._message_came = event.last_message, good

    def _own_failed(self, now: Snapshot, event: FailureSeen) -> List[Request]:
        """Our substitute failed, or fell silent while it changes its program."""
        if event.kind is Kind.NO_VALUE:
            follows = self.substitute.computes and self.state in (State.WELL, *SUBSTITUTED)
            return self._fire(now, Trigger.NO_VALUE) if follows else []
        changing = event.kind is Kind.SILENT and self.substitute.changing(event.time)
        if changing and self.state not in SUBSTITUTED:
            return []
        yielded = event.kind is Kind.SILENT and now.parted and self.yields
        changing = changing or yielded  # the original is heard again, or may be
        if self.incident is not None and event.last_good is not None:
            self.incident = replace(self.incident, last_good=event.last_good)
        if changing:
            return self._fire(now, Trigger.SILENT, event) + self._notice_first_message(now)
        if event.kind is Kind.RATE_LOW and self._is_all_there_is(now):
            text = f"{now.service.topic}: the substitute is slow ({event.detail})"
            return [Log(Level.WARN, f"{text}, and goes on: there is no other."), *self._step()]
        elsewhere = event.kind is Kind.SILENT and bool(self.substitute.host)  # or cut off
        tried = event.kind is not Kind.NODE_GONE and not elsewhere
        return self._substitute_failed(now, event.detail, tried)

    def _is_all_there_is(self, now: Snapshot) -> bool:
        """Whether the service is computed, and cannot be otherwise."""
        if self.incident is None or self.state is not State.HEALED:
            return False
        return self.substitute.another(now, self.incident.faulty_node) is None

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

    def _notice_last_word(self, now: Snapshot) -> None:
        """Who is being killed has left the graph, though its process may take a while longer."""
        incident = self.incident
        if self.state not in SUBSTITUTED or incident is None:
            return
        row = now.publishers.get(incident.faulty_node)
        if row is None or incident.faulty_node not in now.killing:
            return
        if row.state is PublisherState.FAILED and row.kind is Kind.NODE_GONE:
            self._faulty.heard = False

    def _notice_first_message(self, now: Snapshot) -> List[Request]:
        row = now.publishers.get(self.node) if self.node else None
        if self.state is not State.HEALING or row is None:
            return []
        if row.state is not PublisherState.HEALTHY or self._first_message(now) is None:
            return []
        return self._fire(now, Trigger.FIRST_MESSAGE)

    def _refuse(self, now: Snapshot) -> List[Request]:
        """Who is kept out is killed as soon as it is there, before it is heard.

        The substitute goes on. Who costs what nothing replaces is let in once it publishes.
        """
        incident = self.incident
        if incident is None or incident.killed is None:
            return []
        came = any(
            row.publisher == incident.faulty_node
            and row.state is not PublisherState.FAILED
            and row.since > incident.killed
            for row in now.originals
        )
        return self.came_up(now) if came else []

    def _notice_return(self, now: Snapshot) -> List[Request]:
        incident = self.incident
        if incident is None or incident.state is State.RETURNING:
            return []
        if incident.faulty_node in now.killing:
            return []
        failed_at = incident.detected if incident.killed is None else incident.killed
        for row in now.originals:
            if row.state is PublisherState.HEALTHY and row.since > failed_at:
                node = incident.faulty_node
                if self._kept_out and row.publisher == node and not now.awaited(node):
                    self._faulty.failed(row.publisher, Kind.OTHER)
                    requests = self._judge(now, replaced=self.substitute.computes)
                    if not self._faulty.kept:
                        return requests
                return self._fire(now, Trigger.RETURNED)
        return []

    def _refused(self, now: Snapshot, starter: str) -> List[Request]:
        """Who was kept out has been killed: name whoever starts it, ever more seldom."""
        if not self._return.tells(now.time):
            return []
        assert self.incident is not None
        node, topic = self.incident.faulty_node, self.incident.topic
        times = "once" if self._return.refusals == 1 else f"{self._return.refusals} times"
        text = f"{node} is kept out, and was started again {times}"
        text += f" by {starter}" if starter else ""
        said = f"{topic}: {text}. Mend it and release it: rosservice call /shsa/release {topic}"
        return [Log(Level.ERROR, said), *self._step(detail=f"{text}.")]

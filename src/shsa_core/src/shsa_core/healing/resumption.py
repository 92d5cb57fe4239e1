"""Goes on with what a former reconfigurator has left: its incident and its substitute."""
from typing import List, Optional

from shsa_core.healing.events import Level, Log, ShowIncident
from shsa_core.healing.incident import State
from shsa_core.healing.records import Blame, HealingRecord
from shsa_core.healing.repair import Repair
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.transitions import Trigger
from shsa_core.model.kinds import Policy
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import PublisherState

LOOK_AROUND_S = 5.0
"""So long nothing is late that was under way: the monitor may have to start as well."""


class Resumption(Repair):
    """What is written down of the healing of one service, and how it is taken up again."""

    def record(self, row: Optional[Substitution]) -> HealingRecord:
        """What is to be known of it after a death, with its substitute's row."""
        blame = self._faulty.record() if self.incident is not None else None
        trust, healings = self._return.record(), self._limit.moments
        return HealingRecord(self.service, self.incident, blame, row, trust, healings)

    def take_up(self, now: Snapshot, record: HealingRecord, runs: bool) -> List[Request]:
        """Go on as a record says; `runs`: the substitute's process does.

        A node whose kill was not over is judged again once the monitor tells that it still fails:
        under its name there may be another process by now.
        """
        self._return.take_up(record.trust)
        self._limit.take_up(record.healings)
        incident, row = record.incident, record.substitution
        if incident is not None and incident.state is State.ENDED:
            return [ShowIncident(incident)]  # it may not have been written to the log
        if incident is not None and incident.topic != now.service.topic:
            return []
        self.incident = incident
        if incident is not None:
            self._faulty.take_up(incident, record.blame or Blame(incident.kind))
            self._resumes = incident.killed is None and not self._faulty.kept
        plan = None
        if row is not None:
            advises = now.service.policy is Policy.ADVISE
            plan = None if advises else now.planner.recall(now.service, row)
            self.last_message = row.last_message
            if plan is not None:
                since = now.time if incident is None else incident.detected
                self.substitute.take_up(now.time, row, plan, since)
                self.substitute.patience = now.settings.takeover_timeout
        self._set_timer(now)
        requests: List[Request] = [] if incident is None else [ShowIncident(incident)]
        if row is None:
            return requests
        if plan is None:
            why = "what it computes does not fit ontology and SOM, or the policy, any more"
            self.substitute.node, self.substitute.shared = row.node, row.shared
        elif not runs:
            why = "its process died"
        else:
            return requests
        text = f"{now.service.topic}: the substitute that was left behind is of no use: {why}."
        requests += [*self.substitute.failed(now, False), Log(Level.WARN, text)]
        return requests + self._fire(now, Trigger.SUBSTITUTE_FAILED)

    def _set_timer(self, now: Snapshot) -> None:
        """Something must happen in every state, also if nothing is ever heard again."""
        state, later = self.state, now.time + LOOK_AROUND_S
        if state is State.HEALING:
            self._timers[Trigger.LATE if self.substitute.node else Trigger.PREPARE] = later
        elif state is State.RETURNING:
            self._timers[Trigger.STEADY] = now.time + max(LOOK_AROUND_S, self._return.hold_off)
        elif state in (State.UNHEALED, State.SAFE, State.KEPT):
            self._timers[Trigger.RETRY] = later

    def _resume_kill(self, now: Snapshot) -> List[Request]:
        """The monitor tells that the node whose kill was not over still fails."""
        incident = self.incident
        if not self._resumes or incident is None or incident.state is State.RETURNING:
            self._resumes = False
            return []
        row = now.publishers.get(incident.faulty_node)
        if row is None or row.state is not PublisherState.FAILED or row.kind is None:
            return []
        self._resumes = False
        self._faulty.failed(row.publisher, row.kind)
        return self._fire(now, Trigger.NODE_CHANGED)

"""What the loss of a computer is to the healing of one service.

A node that was silent while its computer was not heard has not failed again: the network had. It
is not punished for that by a longer hold-off, and is not kept out.
"""
from dataclasses import replace
from typing import List

from shsa_core.errors import ShsaError
from shsa_core.healing.events import Level, Log
from shsa_core.healing.incident import State
from shsa_core.healing.resumption import Resumption
from shsa_core.healing.snapshot import Request, Snapshot
from shsa_core.healing.transitions import Trigger
from shsa_core.model.kinds import QUIET, Kind
from shsa_core.monitoring.events import PublisherState

PUBLISHED = (State.HEALING, State.HEALED, State.SAFE)


class Stranding(Resumption):
    """The substitute's computer is lost, or the faulty node's."""

    @property
    def publishes(self) -> bool:
        """Whether the substitute publishes.

        It does only when the faulty node is gone and the original is not back.
        """
        return self.state in PUBLISHED and not self._faulty.heard

    def host_lost(self, now: Snapshot, why: str) -> List[Request]:
        """The substitute's computer is not heard any more: another process takes its place.

        While the substitute is heard it goes on, as only the agent may have died; of one whose
        messages are due at no time, that cannot be said.
        """
        row = now.publishers.get(self.node)
        heard = row is not None and row.state is PublisherState.HEALTHY
        if heard and self.publishes and not now.service.event_driven:
            return []
        return self._move(now, f"{self.node} cannot be reached: {why}")

    def rehost(self, now: Snapshot, allowed: bool) -> List[Request]:
        """The computers are others now: one that stands by goes where it belongs.

        One that publishes stays where it is, as long as that is `allowed`.
        """
        if not self.node or self.substitute.plan is None:
            return []
        if not allowed:
            return self._move(now, f"{self.node} must not run on {self.substitute.host or 'here'}")
        if self.state is not State.WELL:
            return []
        try:
            place = now.place(self.substitute.plan)
        except ShsaError:
            return []  # it has a place
        if place.host == self.substitute.host:
            return []
        return self._move(now, f"{self.node} moves to {place.host or 'our own computer'}")

    def _move(self, now: Snapshot, why: str) -> List[Request]:
        """Set another process to work, on another computer."""
        requests: List[Request] = [*self.substitute.drop()]
        requests.append(Log(Level.WARN, f"{now.service.topic}: the substitute {why}."))
        if self.state is State.WELL:
            return requests + self._fire(now, Trigger.PREPARE)
        return requests + self._fire(now, Trigger.SUBSTITUTE_FAILED)

    def unreached(self, now: Snapshot, why: str) -> List[Request]:
        """Nothing can be said of the faulty node: healing goes on, as it is not heard here."""
        assert self.incident is not None
        self._faulty.gone()
        text = f"{self.incident.topic}: {self.incident.faulty_node} may still run: {why}."
        return [Log(Level.WARN, text), *self._step(detail=text)]

    def sends(self, now: Snapshot, seen: str, cause: str) -> List[Request]:
        """The faulty node may do well on its own computer: its substitute bridges what is bad."""
        assert self.incident is not None
        known = self._faulty.excuse == cause
        self._faulty.sends(seen, cause)
        if known:
            return []
        text = f"{self.incident.topic}: {self._faulty.decision}."
        return [Log(Level.WARN, text), *self._step(detail=text)]

    def kill(self, now: Snapshot) -> List[Request]:
        """The kill of the faulty node that has waited for its computer."""
        return [replace(self._faulty.kill(now.service), urgent=True, only_here=False)]

    @property
    def yields(self) -> bool:
        """Whether the substitute is to be still once the faulty node is heard again.

        It is if that was only silent, and nobody has made sure that it is gone.
        """
        waits = self.incident is not None and self.incident.killed is None
        return waits and self.publishes and self.silent

    @property
    def silent(self) -> bool:
        """Whether the faulty node is silent, as one is whose computer is cut off."""
        return self._faulty.kind in QUIET and self._faulty.kind is not Kind.NODE_GONE

    def excuse(self, now: Snapshot, heard: float) -> List[Request]:
        """The faulty node's computer was cut off, and heard last at `heard`, before it failed."""
        if self.incident is None or not self.silent or self._return.failed_at < heard:
            return []
        self._return.excuse()
        return self._step() if self.incident.kept_out is not self._kept_out else []

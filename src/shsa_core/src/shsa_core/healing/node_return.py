"""The way back of a failed node: started again, trusted less each time that it fails, or kept out.
"""
from typing import List, Optional

from shsa_core.healing.events import Level, Log, RestartNode
from shsa_core.healing.kills import KillNode
from shsa_core.healing.settings import Settings
from shsa_core.healing.snapshot import Request, Snapshot


class NodeReturn:
    """What brings back the node of one service, and how far it is trusted.

    By its policy it is started again, after pauses that double, and no more when it failed too
    often. Whoever starts it, its hold-off doubles each time that it fails within it; then it is
    kept out.
    """

    def __init__(self, settings: Settings) -> None:
        self.restarts = 0
        self.exhausted = False
        self._settings = settings
        self._start_at: Optional[float] = None
        self._awaited_by: Optional[float] = None
        self._unstable = 0
        self._well_since: Optional[float] = None

    @property
    def deadline(self) -> Optional[float]:
        """When `tick` has something to do, in s; None: nothing is due."""
        return self._awaited_by if self._start_at is None else self._start_at

    @property
    def hold_off(self) -> float:
        """How long the node must stay healthy when it returns now, in s."""
        settings = self._settings
        longest = max(settings.hold_off, settings.hold_off_limit)
        return min(settings.hold_off * 2.0**self._unstable, longest)

    @property
    def kept_out(self) -> bool:
        """Whether it failed within its hold-off too often to return."""
        return 0 < self._settings.switches <= self._unstable

    def failed(self, time: float) -> None:
        """The node failed after it was well."""
        if self._well_since is not None and time - self._well_since > self._settings.stable:
            self.restarts = 0
        self.exhausted = False

    def failed_again(self) -> None:
        """The node failed within its hold-off."""
        self._unstable += 1

    def gone(self, now: Snapshot) -> None:
        """The node is gone: it is started again if that is its policy. It may be told so twice."""
        if self._start_at is not None:
            return
        self.cancel()
        if not now.service.policy.restarts or self.kept_out:
            return
        if self.restarts >= self._settings.node_restarts:
            self.exhausted = True
            return
        self._start_at = now.time + self._settings.restart_pause * 2.0**self.restarts
        self.restarts += 1

    def tick(self, now: Snapshot, node: str) -> List[Request]:
        """Time passed: the node is to be started, or did not come back in time."""
        topic = now.service.topic
        if not now.service.policy.restarts:
            self.cancel()  # it is another one by now
        if self._start_at is not None and now.time >= self._start_at:
            self._start_at = None
            self._awaited_by = now.time + self._settings.restart_timeout
            return [Log(Level.INFO, f"{topic}: {node} is started again."), RestartNode(node)]
        if self._awaited_by is not None and now.time >= self._awaited_by:
            self._awaited_by = None
            text = f"{topic}: {node} did not come back in time."
            return [Log(Level.WARN, text), KillNode(node, urgent=True)]
        return []

    def cancel(self) -> None:
        """It is not started again now."""
        self._start_at = self._awaited_by = None

    def give_up(self) -> None:
        """It is never started again."""
        self.cancel()
        self.exhausted = True

    def well(self, time: float) -> None:
        """The node has outlived its hold-off."""
        self._well_since = time
        self.trust()

    def trust(self) -> None:
        """Forget its failures within the hold-off."""
        self._unstable = 0

"""The way back of a failed node: started again, trusted less each time that it fails, or kept out.
"""
import math
from typing import List, Optional

from shsa_core.agenda import doubled
from shsa_core.healing.events import Level, Log, RestartNode
from shsa_core.healing.kills import KillNode
from shsa_core.healing.records import Trust
from shsa_core.healing.settings import Settings
from shsa_core.healing.snapshot import Request, Snapshot


class NodeReturn:
    """What brings back the node of one service, and how far it is trusted.

    By its policy it is started again, after pauses that double, and no more when it failed too
    often. Whoever starts it, its hold-off doubles each time that it relapses; then it is kept out.
    A relapse that may be its link's makes the hold-off longer, and keeps nobody out.
    `refusals`: how often it was killed since as it came back. `failed_at`: when it failed last, in
    s.
    """

    def __init__(self, settings: Settings) -> None:
        self.restarts = 0
        self.exhausted = False
        self._settings = settings
        self._start_at: Optional[float] = None
        self._awaited_by: Optional[float] = None
        self.refusals = 0
        self._relapses = 0
        self._doubtful = 0  # of these
        self._returned = -math.inf
        self._well_since: Optional[float] = None
        self._told = 0
        self._soon = False  # its last relapse was after its hold-off
        self._tell_at = -math.inf
        self.failed_at = -math.inf
        self._before = 0, 0, False  # relapses before that, doubtful ones, and whether soon

    @property
    def deadline(self) -> Optional[float]:
        """When `tick` has something to do, in s; None: nothing is due."""
        return self._awaited_by if self._start_at is None else self._start_at

    @property
    def hold_off(self) -> float:
        """How long the node must stay healthy when it returns now, in s."""
        settings = self._settings
        longest = max(settings.hold_off, settings.hold_off_limit)
        return doubled(settings.hold_off, self._relapses, longest)

    @property
    def kept_out(self) -> bool:
        """Whether it relapsed too often in a row to return."""
        return 0 < self._settings.switches <= self._relapses - self._doubtful

    @property
    def may_restart(self) -> bool:
        """Whether it would be started again if its policy is that."""
        used_up = self.exhausted or self.restarts >= self._settings.node_restarts
        return not used_up and not self.kept_out

    def failed(self, time: float, own: bool = True) -> None:
        """The node failed after it had outlived its hold-off; `own`: not its link, for certain."""
        self._note_failure(time)
        if self._well_since is not None and time - self._well_since > self._settings.stable:
            self.restarts = 0
        self.exhausted = False
        within = self._settings.relapse * self._settings.hold_off
        if time - self._returned <= within:
            self._relapse(own)
            self._soon = True
        else:
            self.trust()

    def returned(self, time: float) -> None:
        """The node is back, since `time`."""
        self._returned = time

    def relapsed(self, time: float, own: bool = True) -> None:
        """The node failed within its hold-off; `own`: not its link, for certain."""
        self._note_failure(time)
        self._relapse(own)
        self._soon = False

    def confirm(self) -> None:
        """Its last failure was its own: its computer says so."""
        self._doubtful = min(self._doubtful, self._before[1])

    def excuse(self) -> None:
        """Its last failure was not its own."""
        self._relapses, self._doubtful, self._soon = self._before

    def _note_failure(self, time: float) -> None:
        self.failed_at = time
        self._before = self._relapses, self._doubtful, self._soon

    def _relapse(self, own: bool) -> None:
        self._relapses += 1
        self._doubtful += not own

    def left_in_order(self) -> None:
        """It was no failure: after its hold-off somebody has told the node to leave."""
        if self._soon:
            self.trust()

    def tells(self, time: float) -> bool:
        """Whether to tell that it came back while it was kept out: ever more seldom."""
        tell = time >= self._tell_at
        if tell:
            settings = self._settings
            self._tell_at = time + doubled(settings.retry, self._told, settings.retry_limit)
            self._told += 1
        return tell

    def gone(self, now: Snapshot) -> None:
        """The node is gone: it is started again if that is its policy. It may be told so twice."""
        if self._start_at is not None:
            return
        self.cancel()
        if not now.service.policy.restarts:
            return
        if self.kept_out or self.restarts >= self._settings.node_restarts:
            self.exhausted = True
            return
        self._start_at = now.time + doubled(self._settings.restart_pause, self.restarts)
        self.restarts += 1

    def tick(self, now: Snapshot, node: str) -> List[Request]:
        """Time passed: the node is to be started, or did not come back in time."""
        topic = now.service.topic
        if not now.service.policy.restarts or node != now.service.node:
            self.cancel()  # it is another one by now
        if self._start_at is not None and now.time >= self._start_at:
            self._start_at = None
            self._awaited_by = now.time + self._settings.restart_timeout
            return [Log(Level.INFO, f"{topic}: {node} is started again."), RestartNode(node)]
        if self._awaited_by is not None and now.time >= self._awaited_by:
            self._awaited_by = None
            text = f"{topic}: {node} did not come back in time."
            return [Log(Level.WARN, text), KillNode(node, True, topic=topic)]
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

    def trust(self) -> None:
        """Forget its relapses."""
        self._relapses = self._doubtful = self.refusals = self._told = 0
        self._returned = self._tell_at = -math.inf
        self._soon = False

    def record(self) -> Trust:
        """What is to be known of it after a death."""
        due = self._start_at, self._awaited_by
        returned = None if self._returned == -math.inf else self._returned
        trust = self._relapses, returned, self._soon
        well = self._well_since
        return Trust(self.restarts, self.exhausted, *trust, well, *due, self._doubtful)

    def take_up(self, trust: Trust) -> None:
        """Go on as a former reconfigurator has left it."""
        self.restarts, self.exhausted = trust.restarts, trust.exhausted
        self._relapses, self._soon = trust.relapses, trust.soon
        self._doubtful = trust.doubtful
        self._returned = -math.inf if trust.returned is None else trust.returned
        self._well_since = trust.well_since
        self._start_at, self._awaited_by = trust.start_at, trust.awaited_by

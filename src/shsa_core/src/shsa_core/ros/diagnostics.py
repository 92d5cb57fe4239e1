"""The health table on /diagnostics, once a second, for display; no decision reads it."""
import queue
import threading
from typing import Dict, Optional, Set, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from shsa_core.monitoring.events import Key, PublisherHealth, PublisherState
from shsa_core.ros.graph import clock

PERIOD_S = 1.0
LEVELS = {
    PublisherState.UNKNOWN: DiagnosticStatus.STALE,
    PublisherState.HEALTHY: DiagnosticStatus.OK,
    PublisherState.FAILED: DiagnosticStatus.ERROR,
}

Snapshot = Tuple[Tuple[PublisherHealth, ...], Dict[Key, int], Set[Key]]
"""The health table, how many messages came from each publisher so far, and which of them stand
by.
"""


class Diagnostics:
    """Shows snapshots from a thread of its own: whoever gives one never waits."""

    def __init__(self) -> None:
        self._snapshots: "queue.Queue[Snapshot]" = queue.Queue()
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=2)
        self._counts: Dict[Key, int] = {}
        self._shown: Optional[float] = None
        threading.Thread(target=self._run, name="diagnostics", daemon=True).start()

    def show(self, snapshot: Snapshot) -> None:
        """Publish `snapshot` soon."""
        self._snapshots.put(snapshot)

    def _run(self) -> None:
        while not rospy.is_shutdown():
            table, counts, muted = self._snapshots.get()
            now = clock.now()
            elapsed = None if self._shown is None else now - self._shown
            status = [self._status(row, counts, elapsed, now) for row in table]
            for row, shown in zip(table, status):
                if row.key in muted:
                    shown.level, shown.message = DiagnosticStatus.OK, "stands by, muted"
            self._publisher.publish(
                DiagnosticArray(header=Header(stamp=rospy.Time.now()), status=status)
            )
            self._counts, self._shown = counts, now

    def _status(
        self, row: PublisherHealth, counts: Dict[Key, int], elapsed: Optional[float], now: float
    ) -> DiagnosticStatus:
        values = [KeyValue("state", row.state.value)]
        if elapsed is not None and row.key in self._counts:
            rate = (counts[row.key] - self._counts[row.key]) / elapsed
            values.append(KeyValue("rate in Hz", f"{rate:.1f}"))
        if row.last_good is not None:
            values.append(KeyValue("s since the last good message", f"{now - row.last_good:.3f}"))
        if row.kind:
            values.append(KeyValue("kind", row.kind.value))
        return DiagnosticStatus(
            level=LEVELS[row.state],
            name=f"{row.topic}: {row.publisher or 'nobody'}",
            message=row.detail or row.state.value,
            hardware_id=row.publisher,
            values=values,
        )

"""Carries out what the monitor's core says: tables and failures to others, log lines to people."""
from typing import Callable, Dict, Iterable, Optional

import rospy
from shsa_msgs import msg

from shsa_core import dispatch
from shsa_core.model.service import Service
from shsa_core.monitoring import events
from shsa_core.monitoring.last_messages import LastMessages
from shsa_core.ros.messages.tables import TablePublisher
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.wire import monitoring as wire
from shsa_core.ros.wire import names
from shsa_core.ros.workers import Workers


class Commands:
    """Publishes for the monitor of a `host`; empty: for the robot's."""

    on_server: Callable[[Service], None]

    def __init__(self, last_messages: LastMessages, signing: Signing, host: str) -> None:
        self._last_messages = last_messages
        self._sign = signing.signer(names.FAILURES, msg.Failure)
        self._parameters = Workers("parameters")
        self._changes: Dict[events.Key, Optional[events.PublisherHealth]] = {}
        self._failures = rospy.Publisher(
            names.FAILURES, msg.Failure, queue_size=1000, tcp_nodelay=True
        )
        self._health = TablePublisher(
            names.told_at(names.HEALTH, host),
            msg.Health,
            "publishers",
            wire.health_row_key,
            signing,
        )
        self._calibrations = TablePublisher(
            names.told_at(names.CALIBRATIONS, host),
            msg.Calibrations,
            "calibrations",
            wire.calibration_row_key,
            signing,
        )
        self._carry_out: dispatch.Table[None] = dispatch.table(
            events.Command,
            {
                events.HealthChanged: self._tell_health,
                events.ChangeRefused: self._put_back,
                events.CalibrationsChanged: self._tell_calibrations,
                events.Told: self._tell,
            },
        )

    def carry_out(self, commands: Iterable[events.Command]) -> None:
        """Carry out commands in order; what is told of health may wait for `tell_changes`."""
        for command in commands:
            self._carry_out[type(command)](command)

    def tell_changes(self) -> None:
        """Publish what has changed in the table of health."""
        changes, self._changes = self._changes, {}
        rows = [wire.health_row(row) for row in changes.values() if row is not None]
        removed = [wire.health_key(key) for key, row in changes.items() if row is None]
        self._health.update(rows, removed)

    def _tell_health(self, change: events.HealthChanged) -> None:
        """Tell failures at once; else a turn's changes are published together."""
        self._changes.update({key: None for key in change.removed})
        rows, failed = self._last_messages.rows(change)
        self._changes.update({row.key: row for row in rows})
        if failed:
            self.tell_changes()
        for row in failed:
            self._failures.publish(self._sign(wire.failure_message(row)))

    def _tell_calibrations(self, change: events.CalibrationsChanged) -> None:
        rows = map(wire.calibration_row, change.rows)
        self._calibrations.update(rows, [wire.calibration_key(*key) for key in change.removed])

    def _tell(self, told: events.Told) -> None:
        (rospy.logwarn if told.warning else rospy.loginfo)("%s.", told.text)

    def _put_back(self, refusal: events.ChangeRefused) -> None:
        """Put the numbers that count back, for all who read them, and tell what is refused."""
        service = refusal.service
        text = "Refused: %s. If it is meant, stop the node, change it, and start the node again."
        rospy.logwarn(text, refusal.text)
        self._parameters.put(lambda: self.on_server(service))

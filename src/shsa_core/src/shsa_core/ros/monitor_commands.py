"""Carries out what the monitor's core says: tables and failures to others, log lines to people."""
from typing import Dict, Iterable, Optional

import rospy
from shsa_msgs import msg

from shsa_core import dispatch
from shsa_core.files.som_file import PARAMETER, service_parameters
from shsa_core.monitoring import events
from shsa_core.monitoring.last_messages import LastMessages
from shsa_core.ros.messages.tables import TablePublisher
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.wire import monitoring as wire
from shsa_core.ros.wire import names
from shsa_core.ros.workers import Workers


class Commands:
    """Publishes for the monitor of a `host`; empty: for the robot's."""

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
                events.RobotAwaited: self._tell_awaited,
                events.CalibrationsChanged: self._tell_calibrations,
                events.Bridged: self._tell_bridged,
                events.ChangeAdopted: lambda each: rospy.loginfo("%s counts now.", each.text),
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
        """Tell failures at once, people last; else a turn's changes are published together."""
        self._changes.update({key: None for key in change.removed})
        rows, failed = self._last_messages.rows(change)
        self._changes.update({row.key: row for row in rows})
        if failed:
            self.tell_changes()
        for row in failed:
            self._failures.publish(self._sign(wire.failure_message(row)))
            blamed = f"{row.publisher} fails" if row.publisher else "nobody publishes"
            # The reconfigurator tells people.
            rospy.logdebug("%s: %s, %s: %s.", row.topic, blamed, row.kind, row.detail)

    def _tell_calibrations(self, change: events.CalibrationsChanged) -> None:
        rows = map(wire.calibration_row, change.rows)
        self._calibrations.update(rows, [wire.calibration_key(*key) for key in change.removed])

    def _tell_awaited(self, awaited: events.RobotAwaited) -> None:
        services = ", ".join(f"{topic} from {node}" for topic, node in awaited.services)
        rospy.logwarn("No node of the SOM is there yet. Waiting for: %s.", services)

    def _tell_bridged(self, bridged: events.Bridged) -> None:
        text = "%s: %s has filled in for a late message, %s so far. This is no failure."
        times = "once" if bridged.times == 1 else f"{bridged.times} times"
        rospy.logwarn(text, bridged.topic, bridged.publisher, times)

    def _put_back(self, refusal: events.ChangeRefused) -> None:
        """Say what is refused, and put the numbers that count back, for all who read them."""
        service = refusal.service
        rospy.logwarn(
            "Refused: %s. The previous numbers are put back. If you mean the new ones, "
            "stop the node, set them, and start it as it should be.",
            refusal.text,
        )
        name = f"{PARAMETER}/services/{service.name}"
        self._parameters.put(lambda: rospy.set_param(name, service_parameters(service)))

"""The monitor's ROS shell: brings events to the core, and publishes what it finds.

How a deadline is kept honest when the monitor itself was not scheduled: one thread reads the
sockets and feeds the core, and it reads everything that has come before it lets time pass. The core
hears when that thread wanted to wake and when it did, and how long a message may have waited in its
socket.
"""
import argparse
import sys
import threading
from typing import Any, Callable, Dict, List, Optional

import rospy
from shsa_msgs import msg

from shsa_core import dispatch
from shsa_core.errors import ModelError
from shsa_core.files.parameters import read_settings
from shsa_core.files.som_file import load_som, read_som
from shsa_core.journal.writer import JournalWriter
from shsa_core.model.som import Som
from shsa_core.monitoring import events
from shsa_core.monitoring.machine import Monitor
from shsa_core.monitoring.settings import Settings
from shsa_core.ros import diagnostics
from shsa_core.ros.graph import clock
from shsa_core.ros.graph.connections import Arrived, Closed, Connections, Happening, Lost, Made
from shsa_core.ros.graph.inbox import Inbox
from shsa_core.ros.graph.launch import Launch
from shsa_core.ros.graph.reader import Reader
from shsa_core.ros.graph.som_parameter import SomWatch, get_som_parameter, put_som
from shsa_core.ros.graph.tables import TablePublisher, TableSubscriber
from shsa_core.ros.node import run
from shsa_core.ros.wire import monitoring as wire
from shsa_core.ros.wire import names

LONGEST_WAIT_S = 0.1
"""How long a message has waited is known to this at worst, as long as the monitor is scheduled."""
COALESCE_S = 0.002
"""What comes within this time is handled together."""


class _Report:
    """Time to show the table on /diagnostics."""


class MonitorNode:
    """Hears connections, messages and tables, and says what the core finds.

    Raises ModelError if the SOM is not valid.

    Parameters: those of shsa_core.monitoring.settings.
    """

    def __init__(self, arguments: argparse.Namespace) -> None:
        som = _read(arguments.som)
        settings, errors = read_settings(Settings, rospy.get_param("~", {}), rospy.get_name())
        for error in errors:
            rospy.logerr("Refused: %s. The default is used.", error)
        self._core = Monitor(settings)
        self._journal: Optional[JournalWriter] = None
        if arguments.journal:
            setup = {"settings": settings}
            self._journal = JournalWriter(arguments.journal, "monitoring", setup, rospy.logwarn)
        self._launch = Launch()
        self._inbox = Inbox()
        self._connections = Connections(self._inbox)
        self._reader = Reader()
        self._watched: List[str] = []
        self._looked = clock.now()
        self._ends = False
        self._changes: Dict[events.Key, Optional[events.PublisherHealth]] = {}
        self._failures = rospy.Publisher(
            names.FAILURES, msg.Failure, queue_size=1000, tcp_nodelay=True
        )
        self._health = TablePublisher(names.HEALTH, msg.Health, "publishers", wire.health_row_key)
        self._diagnostics = diagnostics.Diagnostics()
        self._carry_out: dispatch.Table[None] = dispatch.table(
            events.Command,
            {
                events.FailureDetected: self._tell_failure,
                events.HealthChanged: self._tell_health,
            },
        )
        self._hear = {
            Made: self._connection_changed,
            Closed: self._connection_changed,
            Som: self._som_changed,
            msg.Substitutions: lambda table: self._feed(wire.substitutions_changed(table)),
            _Report: self._report,
        }
        self._inbox.put(som)
        if not get_som_parameter():
            put_som(som)
        SomWatch(som, self._inbox.put, lambda: read_som(arguments.som))
        TableSubscriber(names.SUBSTITUTIONS, msg.Substitutions, self._inbox.put)
        threading.Thread(target=self._remind, name="remind", daemon=True).start()

    def spin(self) -> None:
        """Handle events until ROS shuts down."""
        while not rospy.is_shutdown():
            self._guarded(self._turn)
        if self._journal is not None:
            self._journal.close()

    def _turn(self) -> None:
        """Wait for something to do, read everything that has come, then let time pass."""
        wanted = min(self._core.next_deadline, clock.now() + LONGEST_WAIT_S)
        self._inbox.wait(wanted - clock.now())
        woke = clock.now()
        rest = self._looked + COALESCE_S - woke
        if rest > 0.0:
            rospy.rostime.wallsleep(rest)
        before, looked = self._looked, clock.now()
        self._looked = looked
        ready = self._inbox.ready()
        items = self._inbox.take()
        self._heed_launch()
        for item in items:
            self._guarded(self._handle, item)
        happenings = self._connections.read(ready)
        self._heed_launch()
        for happening in happenings:
            self._guarded(self._happened, happening, before)
        self._feed(events.Tick(looked, wanted, woke))
        self._show_health()

    def _heed_launch(self) -> None:
        """Look whether the launch is ending, after something was read and before it is fed.

        Who stops because of that stops after it was told to, and so after the launch has said it.
        """
        if not self._ends and self._launch.ending():
            self._ends = True
            self._feed(events.Ending(clock.now()))
            rospy.loginfo("The launch is ending: what stops from now on is no failure.")

    def _guarded(self, handle: Callable[..., None], *what: Any) -> None:
        """Handle something; whatever goes wrong with it, the rest is still handled."""
        try:
            handle(*what)
        except Exception as error:
            if not rospy.core.is_shutdown_requested():
                rospy.logerr_throttle_identical(10.0, f"Monitor: {type(error).__name__}: {error}")

    def _handle(self, item: Any) -> None:
        self._hear[type(item)](item)

    def _connection_changed(self, item: Any) -> None:
        for happening in self._connections.heed(item):
            self._happened(happening, self._looked)

    def _happened(self, happening: Happening, before: float) -> None:
        """Feed what happened at a connection at some time since `before`."""
        now = clock.now()
        if isinstance(happening, Arrived):
            connection, data = happening
            service = self._core.service_of(connection.topic, connection.publisher)
            self._feed(self._reader.event(now, now - before, connection, data, service))
        elif isinstance(happening, Lost):
            self._feed(events.Disconnected(now, *happening))
        else:
            self._feed(events.Connected(now, *happening))

    def _feed(self, event: events.Event) -> None:
        if self._journal is not None:
            self._journal.record(event)
        commands = self._core.handle(event)
        for command in commands:
            self._carry_out[type(command)](command)
        if self._journal is not None:
            self._journal.answered(commands)

    def _tell_failure(self, failure: events.FailureDetected) -> None:
        self._failures.publish(wire.failure_message(failure))
        blamed = f"{failure.publisher} fails" if failure.publisher else "nobody publishes"
        # The reconfigurator tells people.
        rospy.logdebug("%s: %s, %s: %s.", failure.topic, blamed, failure.kind, failure.detail)

    def _tell_health(self, change: events.HealthChanged) -> None:
        self._changes.update({key: None for key in change.removed})
        self._changes.update({row.key: row for row in change.rows})

    def _show_health(self) -> None:
        """Publish the changes of this turn, after its failures."""
        changes, self._changes = self._changes, {}
        rows = [wire.health_row(row) for row in changes.values() if row is not None]
        removed = [wire.health_key(key) for key, row in changes.items() if row is None]
        self._health.update(rows, removed)

    def _som_changed(self, som: Som) -> None:
        """Subscribe new topics, end the subscriptions of those that left."""
        self._feed(events.SomChanged(clock.now(), som))
        for topic in set(self._watched) - set(som.topics()):
            self._connections.unsubscribe(topic)
            rospy.loginfo("%s is no longer watched.", topic)
        for topic in som.topics():
            if topic not in self._watched:
                self._connections.subscribe(topic)
                rospy.loginfo("%s is watched.", topic)
        self._watched = list(som.topics())

    def _remind(self) -> None:
        while not rospy.is_shutdown():
            rospy.rostime.wallsleep(diagnostics.PERIOD_S)
            self._inbox.put(_Report())

    def _report(self, _: _Report) -> None:
        core = self._core
        self._diagnostics.show((core.table(), core.messages(), core.muted()))


def _read(path: str) -> Som:
    """The valid services of a SOM file; errors of the others are logged. Raises ModelError."""
    som, errors = load_som(path)
    for error in errors:
        rospy.logerr("Refused: %s", error)
    if not som.services:
        raise ModelError(path, "there is no valid service to watch")
    return som


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="monitor", description=__doc__.splitlines()[0])
    parser.add_argument("--som", required=True, help="the SOM file: the services to watch")
    parser.add_argument("--journal", default="", help="a file for every event, to be replayed")
    return parser.parse_args(rospy.myargv(sys.argv)[1:])


def main() -> None:
    """Run the node `monitor`."""
    arguments = _arguments()
    run("monitor", lambda: MonitorNode(arguments).spin())

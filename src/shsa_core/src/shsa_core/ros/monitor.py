"""The monitor's ROS shell: brings events to the core, and publishes what it finds.

How a deadline is kept honest when the monitor itself was not scheduled: one thread reads the
sockets and feeds the core, and it reads everything that has come before it lets time pass. The core
hears when that thread wanted to wake and when it did, when the kernel received a message, and how
long others of the same read may have waited for it. Time passes for the core as far as all was read
that had come: what comes while it is read is of later.
"""
import argparse
import sys
from functools import partial
from operator import attrgetter
from typing import Dict, Optional, Set

import rospy
from shsa_msgs import msg

from shsa_core import dispatch, message_types
from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.som_file import load_som, read_som
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.health import Key, PublisherHealth
from shsa_core.model.names import file_name
from shsa_core.model.ontology import EMPTY, Ontology
from shsa_core.model.som import Som
from shsa_core.monitoring import events
from shsa_core.monitoring.last_messages import LastMessages
from shsa_core.monitoring.machine import Monitor
from shsa_core.monitoring.settings import Settings
from shsa_core.ros import clock, diagnostics, settings
from shsa_core.ros.master import som_parameter
from shsa_core.ros.messages.tables import TablePublisher, TableSubscriber
from shsa_core.ros.node import LOG, read_parameters, recorded, run
from shsa_core.ros.processes.heartbeats import RECONFIGURATOR, Signs
from shsa_core.ros.processes.kernel import waited_in_all
from shsa_core.ros.processes.launch import Launch, Launches, await_turn
from shsa_core.ros.processes.watching import Companion
from shsa_core.ros.reader import event_of
from shsa_core.ros.sockets import subscriptions
from shsa_core.ros.trust.signing import SignedPublisher, Signing
from shsa_core.ros.wire import healing as wire, names
from shsa_core.ros.wire.rows import filled
from shsa_core.ros.workers import UrgentFirst, Workers, guarded


class MonitorNode:
    """Hears connections, messages and tables, and says what the core finds.

    Parameters: those of shsa_core.monitoring.settings. Raises ModelError if the SOM is not valid.
    """

    def __init__(self, arguments: argparse.Namespace) -> None:
        som, self._arguments = _read(arguments), arguments
        signing = Signing(arguments.secret)
        parameters = read_parameters(Settings)
        ontology = _read_ontology(arguments.ontology)
        self._core = Monitor(parameters, ontology)
        journal = arguments.journal and file_name(arguments.journal, rospy.get_namespace())
        setup = {"settings": parameters, "ontology": ontology}
        self._answer, self._close = recorded(journal, "monitoring", setup, self._core.handle)
        self._launch, self._launches = Launch(), Launches()
        self._subscriptions = subscriptions.Subscriptions(clock.now, signing.refusals.note)
        self._inbox = self._subscriptions.inbox
        # Only the monitor that the reconfigurator watches may hear, and so end, it in turn.
        self._companion = Companion(RECONFIGURATOR, Signs(names.monitor_of(arguments.host)))
        self._last_messages = LastMessages()
        self._parameters = Workers("parameters")
        self._changes: Dict[Key, Optional[PublisherHealth]] = {}
        self._failures = SignedPublisher(signing, names.FAILURES, msg.Failure, 1000)
        health, calibrations = names.told_by_monitor(arguments.host)
        self._health = TablePublisher(
            health, msg.Health, "publishers", wire.health_row_key, signing
        )
        self._calibrations = TablePublisher(
            calibrations, msg.Calibrations, "calibrations", attrgetter("key"), signing
        )
        self._carry_out: dispatch.Table[None] = dispatch.table(
            events.Command,
            {
                events.HealthChanged: self._tell_health,
                events.ChangeRefused: self._put_back,
                events.CalibrationsChanged: self._tell_calibrations,
                events.Log: lambda c: LOG[c.level]("%s.", c.text),
            },
        )
        self._registrations = UrgentFirst("registrations", settings.PAUSE_S)
        self._topics: Set[str] = set()
        self._pending: Set[str] = set()  # topics that are being subscribed
        self._looked = self._told_clock = self._fed = clock.now()
        self._ahead = 0.0
        self._diagnostics = diagnostics.Diagnostics(
            lambda: self._inbox.put(lambda: self._diagnostics.show(self._core.overview())),
            diagnostics.MonitorRows(),
            signing,
            self._companion,
        )
        later = lambda handle: lambda heard: self._inbox.put(partial(handle, heard))
        som_changed = later(self._som_changed)
        som_changed(som)
        if som_parameter.get_som_parameter() == {}:
            som_parameter.put_som(som)
        reread = partial(read_som, arguments.som, rospy.get_namespace())
        watch = som_changed, arguments.live_parameters, reread
        self._som_watch = som_parameter.SomWatch(som, *watch)
        changed = later(self._substitutions_changed)
        TableSubscriber(names.SUBSTITUTIONS, msg.Substitutions, changed, signing)
        TableSubscriber(names.SOM_STATE, msg.SomState, later(self._som_state), signing)

    def spin(self) -> None:
        """Handle events until ROS shuts down."""
        while not rospy.is_shutdown():
            guarded("The monitor", self._turn)
        self._close()

    def _turn(self) -> None:
        """Wait for something to do, read everything that has come, then let time pass."""
        self._companion.beat()
        wanted = min(self._core.next_deadline, clock.now() + settings.TURN_S)
        self._inbox.wait(wanted - clock.now())
        rest = min(self._looked + settings.REST_S, wanted) - clock.now()
        if rest > 0.0:
            self._inbox.rest(rest)
        items = self._inbox.take()
        self._heed_launch()
        for item in items:
            guarded("The monitor", item)
        self._tell_clock()
        happenings = self._subscriptions.read(self._fed)
        self._heed_launch()
        for happening in happenings:
            self._companion.beat()  # who has much to catch up with does not hang
            if isinstance(happening, events.Tick):
                self._looked = happening.time
                happening = events.Tick(happening.time, max(0.0, happening.time - wanted))
            guarded("The monitor", self._happened, happening)
        self._tell_changes()

    def _heed_launch(self) -> None:
        """Look once something was read, before it is fed: the launch first says that it ends."""
        if self._launch.ending():
            self._feed(events.Ending(clock.now()))
            rospy.loginfo("The launch is ending: what stops from now on is no failure.")
        nodes = self._launches.ending()
        if nodes:
            self._feed(events.Ending(clock.now(), nodes))
            text = "The launch of %s is ending: that they stop is no failure."
            rospy.loginfo(text, ", ".join(nodes))

    def _tell_clock(self) -> None:
        """Look at ROS time before messages are read: their age is told by this look."""
        now, ros_time = clock.both()
        before, self._ahead = self._ahead, ros_time - now
        if abs(self._ahead - before) > settings.REST_S or now - self._told_clock > settings.TURN_S:
            self._told_clock = now
            path = self._arguments.pressure
            waited = (*waited_in_all(path), *self._launches.waited()) if path else ()
            self._feed(events.ClockTicked(now, ros_time, clock.is_simulated(), waited))

    def _happened(self, happening: subscriptions.Happening) -> None:
        if isinstance(happening, subscriptions.Arrived):
            self._arrived(happening)
            return
        if isinstance(happening, events.Connected):
            self._subscribed(happening.topic)  # our thread for that may say so later
        self._feed(happening)
        if isinstance(happening, events.Connected):
            service = self._core.service_of(happening.topic, happening.publisher)
            if service is not None and service.node == happening.publisher:
                self._launches.learn(happening.publisher)

    def _arrived(self, arrived: subscriptions.Arrived) -> None:
        time, connection, data, whole = arrived[:4]
        service = self._core.service_of(connection.topic, connection.publisher)
        message = event_of(arrived, service)
        if service is not None and service.needed is not False and whole and not message.foreign:
            self._last_messages.keep(time, connection.topic, connection.publisher, data)
        self._feed(message)

    def _feed(self, event: events.Event) -> None:
        if not isinstance(event, events.ClockTicked):  # what is told of it had come before
            self._fed = event.time
        for command in self._answer(event):
            self._carry_out[type(command)](command)

    # Commands.

    def _tell_changes(self) -> None:
        """Publish what has changed in the table of health."""
        changes, self._changes = self._changes, {}
        rows = [filled(msg.PublisherHealth, row) for row in changes.values() if row is not None]
        removed = [wire.health_key(key) for key, row in changes.items() if row is None]
        self._health.update(rows, removed)

    def _tell_health(self, change: events.HealthChanged) -> None:
        """Tell failures at once; else a turn's changes are published together."""
        self._changes.update(dict.fromkeys(change.removed))
        rows, failed = self._last_messages.rows(change)
        self._changes.update({row.key: row for row in rows})
        if failed:
            self._tell_changes()
        for row in failed:
            self._failures.publish(wire.failure_message(row))

    def _tell_calibrations(self, change: events.CalibrationsChanged) -> None:
        rows = map(wire.calibration_row, change.rows)
        self._calibrations.update(rows, [wire.calibration_key(*key) for key in change.removed])

    def _put_back(self, refusal: events.ChangeRefused) -> None:
        """Put the numbers that count back, for all who read them, and tell what is refused."""
        service = refusal.service
        text = "Refused: %s. If it is meant, stop the node, change it, and start the node again."
        rospy.logwarn(text, refusal.text)
        self._parameters.put(lambda: self._som_watch.put_back(service))

    # Tables and the SOM.

    def _som_state(self, table: msg.SomState) -> None:
        if table.whole:  # what is told later follows from what we say ourselves
            self._feed(wire.formerly_healthy(table))

    def _substitutions_changed(self, table: msg.Substitutions) -> None:
        event = wire.substitutions_changed(table)
        self._last_messages.substitutions(event.rows)
        self._feed(event)

    def _som_changed(self, som: Som) -> None:
        """Subscribe new topics by and by, end the subscriptions of those that left."""
        som = with_unknowns(_share(self._arguments, som), message_types.layout)
        self._feed(events.SomChanged(clock.now(), som))
        self._topics = set(som.topics())
        for topic in som.topics():
            if topic not in self._pending and topic not in self._subscriptions.topics:
                self._pending.add(topic)
                self._registrations.put(topic, partial(self._subscribe, topic))
        for topic in set(self._subscriptions.topics) - self._topics - self._pending:
            self._leave(topic)

    def _subscribe(self, topic: str) -> None:
        """Called in a thread that may wait for the master."""
        try:
            self._subscriptions.subscribe(topic)
        except Exception:  # whatever it is, it is tried again, and said
            self._registrations.put(topic, partial(self._subscribe, topic))
            raise
        self._inbox.put(partial(self._subscribed, topic))

    def _subscribed(self, topic: str) -> None:
        if topic in self._pending:
            self._pending.discard(topic)
            self._feed(events.Subscribed(clock.now(), topic))
            rospy.loginfo("%s is watched.", topic)
            if topic not in self._topics:
                self._leave(topic)

    def _leave(self, topic: str) -> None:
        self._registrations.put(topic, self._subscriptions.unsubscribe(topic))
        rospy.loginfo("%s is no longer watched.", topic)


def _read(arguments: argparse.Namespace) -> Som:
    """The valid services of a SOM file. Raises ModelError if there is nothing to watch."""
    path = arguments.som
    som, errors = load_som(path, rospy.get_namespace())
    for error in errors:
        rospy.logerr("Refused: %s", error)
    for host in (arguments.host, *arguments.beside):
        if host and host not in som.hosts:
            there = ", ".join(som.hosts) or "none"
            raise ModelError(f"{path}/hosts", f"there is no host {host!r}; there are: {there}")
    if not _share(arguments, som).services:
        raise ModelError(path, "there is no valid service to watch")
    return som


def _share(arguments: argparse.Namespace, som: Som) -> Som:
    """Return the part of a SOM that this monitor watches."""
    hosts = [arguments.host] if arguments.host else arguments.beside
    return som.at(hosts, beside=not arguments.host)


def _read_ontology(path: str) -> Ontology:
    """Return the ontology for comparisons, as far as there is one that can be read."""
    if not path:
        return EMPTY
    try:
        ontology, errors = load_ontology(path)
    except ModelError as unreadable:
        rospy.logerr("Witnesses and calibration are off: %s", unreadable)
        return EMPTY
    for error in errors:
        rospy.logerr("Refused: %s", error)
    return ontology


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="monitor", description=__doc__.splitlines()[0])
    parser.add_argument("--som", required=True, help="the SOM file: the services to watch")
    parser.add_argument("--ontology", default="", help="the ontology file, for checks by witnesses")
    parser.add_argument("--journal", default="", help="a file for every event, to be replayed")
    parser.add_argument(
        "--live-parameters", action="store_true", help=som_parameter.LIVE_PARAMETERS
    )
    pressure = "the kernel's file of who waits for a processor; empty: nobody is excused by that"
    parser.add_argument("--pressure", default="/proc/pressure/cpu", help=pressure)
    parser.add_argument("--secret", default="", help="the file with the secret of healing")
    whose = parser.add_mutually_exclusive_group()
    whose.add_argument("--host", default="", help="watch the services of this computer alone")
    whose.add_argument(
        "--beside", nargs="*", default=(), help="computers whose services others watch"
    )
    return parser.parse_args(rospy.myargv(sys.argv)[1:])


def main() -> None:
    """Run the node `monitor`."""
    arguments = _arguments()
    name = names.monitor_of(arguments.host)
    await_turn(name)
    run(name, lambda: MonitorNode(arguments).spin())

"""The gate's ROS shell: publishes what its core lets pass of what is published, byte for byte."""
import argparse
import struct
import sys
from dataclasses import replace
from typing import Dict

import rospy
from shsa_msgs import msg

from shsa_core import dispatch
from shsa_core.errors import ModelError
from shsa_core.files.som_file import read_som
from shsa_core.message_types import message_class
from shsa_core.model.names import full_name
from shsa_core.model.service import Service
from shsa_core.monitoring.events import Disconnected, SubstitutionsChanged, Tick
from shsa_core.ros import clock, settings
from shsa_core.ros.messages.fields import stamp
from shsa_core.ros.rospy_patches.publishing import advertise, as_written
from shsa_core.ros.reader import ALL, event_of
from shsa_core.ros.sockets.subscriptions import Arrived, Subscriptions
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.messages.tables import TableSubscriber
from shsa_core.ros.node import LOG, run
from shsa_core.ros.wire import names
from shsa_core.ros.wire.rows import substitution_row
from shsa_core.ros.workers import guarded
from shsa_gate import events
from shsa_gate.machine import Gate


class GateNode:
    """Brings events to the core, and carries out what it says.

    Raises ModelError if the SOM is not valid, or has no such service with a gate, and ShsaError if
    its type is not built here.
    """

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._service = _service(arguments)
        first = arguments.standby and full_name(arguments.standby, rospy.get_namespace())
        signing = Signing(arguments.secret)
        self._kind = message_class(self._service.type)
        self._fed = clock.now()
        self._core = Gate(self._service, first, self._fed)
        self._subscriptions = Subscriptions(clock.now, signing.refusals.note)
        self._inbox = self._subscriptions.inbox
        self._written = as_written(self._kind)
        heard, latched = self._service.heard, self._service.latched
        self._publisher = advertise(heard, self._kind, settings.CONSUMER_QUEUE, latch=latched)
        self._carry_out: dispatch.Table[None] = dispatch.table(
            events.Command,
            {events.Pass: self._pass, events.Log: lambda c: LOG[c.level]("%s.", c.text)},
        )
        self._subscriptions.subscribe(self._service.topic)
        if first:
            self._subscriptions.subscribe(self._service.heard)
        TableSubscriber(names.SUBSTITUTIONS, msg.Substitutions, self._inbox.put, signing)

    def spin(self) -> None:
        """Handle events until ROS shuts down."""
        while not rospy.is_shutdown():
            guarded("The gate", self._turn)

    def _turn(self) -> None:
        """Wait for something to do, and feed everything that has come."""
        now = clock.now()
        self._inbox.wait(min(self._core.next_deadline, now + settings.TURN_S) - now)
        for item in self._inbox.take():
            self._feed(substitutions_changed(item))
        happenings = self._subscriptions.read(self._fed)
        newest = {each.connection: each.data for each in happenings if isinstance(each, Arrived)}
        for happening in happenings:
            if isinstance(happening, Arrived):
                self._arrived(happening, newest[happening.connection] is happening.data)
            elif isinstance(happening, (Disconnected, Tick)):
                self._feed(happening)

    def _arrived(self, arrived: Arrived, newest: bool) -> None:
        connection, data = arrived.connection, arrived.data
        overheard = connection.topic == self._service.heard
        judged = None if overheard else self._core.service_of(connection.publisher)
        message = event_of(arrived, judged, ALL)
        sent, error = connection.header, message.error
        if (sent["type"], sent["md5sum"]) != (self._kind._type, self._kind._md5sum):
            ours = self._kind._type
            error = f"it is a {sent['type']} of another version or type than {ours} here"
        stamped = stamp(data) if self._kind._has_header else 0
        self._feed(events.Arrived(replace(message, stamp=stamped, error=error), data, newest))

    def _feed(self, event: events.Event) -> None:
        self._fed = event.time
        for command in self._core.handle(event):
            self._carry_out[type(command)](command)

    def _pass(self, command: events.Pass) -> None:
        data = command.data
        if command.stamp is not None:
            written = bytearray(data)
            struct.pack_into("<II", written, 4, *divmod(command.stamp, 10**9))
            data = bytes(written)
        self._publisher.publish(self._written(data))


def substitutions_changed(table: msg.Substitutions) -> SubstitutionsChanged:
    """Return the event of a message on shsa/substitutions; rows are whole, with their errors.

    Raises ShsaError if a row is none.
    """
    rows = tuple(map(substitution_row, table.substitutions))
    return SubstitutionsChanged(clock.now(), rows, tuple(table.removed), table.whole)


def _service(arguments: argparse.Namespace) -> Service:
    som = read_som(arguments.som, rospy.get_namespace())
    gated: Dict[str, Service] = {each.name: each for each in som if each.gated}
    if arguments.service not in gated:
        known = ", ".join(gated) or "none"
        text = f"there is no service {arguments.service!r} with a gate; there are: {known}"
        raise ModelError(f"{arguments.som}/services", text)
    return gated[arguments.service]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="gate", description=__doc__.splitlines()[0])
    parser.add_argument("service", help="the name of the service in the SOM; it has a gate there")
    parser.add_argument("--som", required=True, help="the SOM file")
    parser.add_argument("--secret", default="", help="the file with the secret of healing")
    parser.add_argument(
        "--standby", default="", metavar="NODE", help="be ready to replace this gate"
    )
    return parser.parse_args(rospy.myargv(sys.argv)[1:])


def main() -> None:
    """Run the node `gate`."""
    arguments = _arguments()
    run("gate", lambda: GateNode(arguments).spin())

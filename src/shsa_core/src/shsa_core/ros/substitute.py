"""The substitute: a node made of three strings that takes over a topic (Section V-A3)."""
import functools
import os
import sys
from typing import TYPE_CHECKING, Callable, Tuple

import rospy
from shsa_msgs import msg

from shsa_core.dispatch import Table, table
from shsa_core.errors import ShsaError
from shsa_core.model.substitution import Substitution
from shsa_core.ros.graph import announce, clock
from shsa_core.ros.graph.fields import Field
from shsa_core.ros.graph.inbox import Inbox
from shsa_core.ros.graph.inputs import Inputs, Values
from shsa_core.ros.graph.messages import message_class
from shsa_core.ros.graph.node_api import FAILURES
from shsa_core.ros.graph.original import served_consumers
from shsa_core.ros.graph.outputs import Outputs
from shsa_core.ros.wire import names
from shsa_core.ros.wire.rows import only_rows_of, substitution_row
from shsa_core.ros.graph.tables import TableSubscriber
from shsa_core.ros.graph.worker import Worker
from shsa_core.ros.node import run
from shsa_core.substitution import events, machine
from shsa_core.substitution.signals import JOURNAL, VARIABLE, decode

if TYPE_CHECKING:
    from shsa_core.journal.writer import JournalWriter

POLL_S = 0.1  # between two looks whether ROS shuts down
USAGE = "usage: rosrun shsa_core substitute INPUTS CODE OUTPUT"
Paths = Tuple[str, ...]

LOG = {
    events.Level.DEBUG: rospy.logdebug,
    events.Level.INFO: rospy.loginfo,
    events.Level.WARNING: rospy.logwarn,
    events.Level.ERROR: rospy.logerr,
}


class SubstituteNode:
    """Brings events to the core, and carries out what it says.

    One thread handles events in order, and publishes. What waits for the master or for another node
    has threads of its own: a takeover needs neither. `journal`: a file for every event; empty:
    none.
    """

    def __init__(self, row: Substitution, journal: str) -> None:
        self._name = row.node
        self._row = row
        self._listed = False
        self._idle = row.idle
        self._core = machine.Substitute()
        self._journal = _journal(journal) if journal else None
        self._inbox = Inbox()
        self._inputs = Inputs(self._heard)
        self._outputs = Outputs(self._advertised, self._joined)
        self._registrations = Worker("registrations")
        self._calls = Worker("calls")
        self._looks = Worker("looks")
        self._carry_out: Table[None] = table(
            events.Command,
            {
                events.Listen: self._listen,
                events.Advertise: self._advertise,
                events.Withdraw: self._withdraw,
                events.Publish: self._publish,
                events.Announce: self._announce,
                events.FindSubscribers: self._find_subscribers,
                events.Tell: self._tell,
                events.LookAtOriginal: self._look_at_original,
                events.GiveUp: self._give_up,
                events.Log: self._log,
            },
        )

    def spin(self) -> None:
        """Follow the table of substitutions until ROS shuts down.

        Raises ShsaError if the core gives up.
        """
        try:
            self._follow()
        finally:
            if self._journal is not None:
                self._journal.close()

    def _follow(self) -> None:
        self._feed(events.Started(clock.now(), self._row, unusable(self._row)))
        message_class = only_rows_of(self._name, lambda: self._idle)
        TableSubscriber(names.SUBSTITUTIONS, message_class, self._table)
        while not rospy.is_shutdown():
            deadline = self._core.next_deadline()
            wait = POLL_S if deadline is None else min(POLL_S, deadline - clock.now())
            self._inbox.wait(wait)
            self._inbox.ready()
            for event in self._inbox.take():
                self._feed(event)
            deadline = self._core.next_deadline()
            if deadline is not None and clock.now() >= deadline:
                self._feed(events.Tick(clock.now()))

    def _feed(self, event: events.Event) -> None:
        if self._journal is not None:
            self._journal.record(event)
        commands = self._core.handle(event)
        if self._journal is not None:
            self._journal.answered(commands)
        for command in commands:
            self._carry_out[type(command)](command)

    # Events, from rospy's threads.

    def _table(self, message: msg.Substitutions) -> None:
        ours = [row for row in message.substitutions if row.node == self._name]
        for found in ours:
            row = substitution_row(found)
            self._listed = True
            self._idle = row.idle
            self._inbox.put(events.RowChanged(clock.now(), row, unusable(row)))
        gone = message.whole and not ours or self._name in message.removed
        if gone and self._listed:
            self._listed = False
            self._inbox.put(events.RowRemoved(clock.now()))
        if self._idle:
            plans = tuple(substitution_row(row) for row in message.substitutions if not row.node)
            problems = tuple(problem for plan in plans for problem in unusable(plan))
            removed = tuple(message.removed)
            self._inbox.put(
                events.PlansChanged(clock.now(), plans, removed, message.whole, problems)
            )

    def _heard(self, topic: str, publisher: str, values: Values) -> None:
        self._inbox.put(events.InputArrived(clock.now(), topic, publisher, values))

    def _advertised(self, topic: str) -> None:
        self._inbox.put(events.Advertised(clock.now(), topic))

    def _joined(self, topic: str, consumer: str) -> None:
        self._inbox.put(events.ConsumerJoined(clock.now(), topic, consumer))

    # Commands.

    def _listen(self, command: events.Listen) -> None:
        self._registrations.put(lambda: self._inputs.listen(command.inputs))

    def _advertise(self, command: events.Advertise) -> None:
        self._registrations.put(lambda: self._outputs.advertise(command.topic, command.type))

    def _withdraw(self, command: events.Withdraw) -> None:
        self._registrations.put(lambda: self._outputs.withdraw(command.topics))

    def _publish(self, command: events.Publish) -> None:
        self._outputs.publish(command.outputs, command.values, command.served, command.only)

    def _announce(self, command: events.Announce) -> None:
        def call() -> None:
            announce.announce(command.topic, command.type)

        self._call(f"announcing {command.topic}", call)

    def _find_subscribers(self, command: events.FindSubscribers) -> None:
        def call() -> None:
            for topic, nodes in announce.find_subscribers(command.topics).items():
                connected = self._outputs.connected(topic)
                self._inbox.put(events.SubscribersFound(clock.now(), topic, nodes, connected))

        self._call(f"looking for the subscribers of {', '.join(command.topics)}", call)

    def _tell(self, command: events.Tell) -> None:
        nodes = ", ".join(command.subscribers)
        self._call(
            f"telling {nodes} of {command.topic}",
            lambda: announce.tell(command.topic, command.subscribers),
        )

    def _call(self, what: str, call: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                call()
            except FAILURES as error:
                self._inbox.put(events.CallFailed(clock.now(), what, str(error)))

        self._calls.put(guarded)

    def _look_at_original(self, look: events.LookAtOriginal) -> None:
        def call() -> None:
            consumers = served_consumers(look.topic, look.original)
            self._inbox.put(events.OriginalServes(clock.now(), look, consumers))

        self._looks.put(call)

    def _give_up(self, command: events.GiveUp) -> None:
        raise ShsaError(command.reason)

    def _log(self, command: events.Log) -> None:
        LOG[command.level]("%s: %s", self._name, command.text)


def unusable(row: Substitution) -> events.Unusable:
    """The signals of a row that cannot be read or written here, each with the reason."""
    problems = ((each, _problem(each.type, each.field)) for each in (*row.inputs, *row.outputs))
    return tuple((signal, problem) for signal, problem in problems if problem)


@functools.lru_cache(maxsize=None)
def _problem(kind: str, field: str) -> str:
    """Why a field cannot be read or written; empty if it can.

    A takeover asks for nothing that is new.
    """
    try:
        Field(message_class(kind), field)
    except ShsaError as error:
        return str(error)
    return ""


def _paths(text: str) -> Paths:
    return tuple(path.strip() for path in text.split(",") if path.strip())


def _by_hand(inputs: Paths, code: str, outputs: Paths) -> Substitution:
    """The row of a substitute that somebody started by hand: what it must know is looked up."""
    from shsa_core.ros.graph.som_lookup import (
        look_up,
    )  # not for those who ask nobody: it takes long

    signals = look_up((*inputs, *outputs))
    muted = bool(rospy.get_param("~muted", False))
    n_inputs = len(inputs)
    return Substitution(
        rospy.get_name(), "", signals[:n_inputs], code, signals[n_inputs:], publishing=not muted
    )


def _by_reconfigurator(inputs: Paths, code: str, outputs: Paths, text: str) -> Substitution:
    """The row of a substitute whose signals came with its strings: muted at first."""
    signals = decode(text)
    if tuple(tuple(signal.path for signal in each) for each in signals) != (inputs, outputs):
        raise ShsaError(f"{VARIABLE} does not hold the signals of INPUTS and OUTPUT")
    return Substitution(rospy.get_name(), "", signals[0], code, signals[1])


def _journal(path: str) -> "JournalWriter":
    from shsa_core.journal.writer import JournalWriter  # not for those without: it takes long

    return JournalWriter(path, "substitution", {}, rospy.logwarn)


def main() -> None:
    """Run the node: three strings on the command line.

    `~muted` starts it muted, `~journal` is a file for every event.
    """
    arguments = rospy.myargv(sys.argv)[1:]
    if len(arguments) != 3:
        raise SystemExit(USAGE)
    strings = _paths(arguments[0]), arguments[1], _paths(arguments[2])
    text = os.environ.get(VARIABLE)

    def work() -> None:
        if text is None:
            SubstituteNode(_by_hand(*strings), rospy.get_param("~journal", "")).spin()
        else:
            SubstituteNode(_by_reconfigurator(*strings, text), os.environ.get(JOURNAL, "")).spin()

    run("substitute", work)


def standby() -> None:
    """Run an idle substitute, to be given its program by its row."""

    def work() -> None:
        row = Substitution(rospy.get_name(), "", (), "", ())
        SubstituteNode(row, os.environ.get(JOURNAL, "")).spin()

    run("standby", work)

"""The substitute: a node made of three strings that takes over a topic (Section V-A3)."""
import os
import sys
import threading
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from typing import Callable, Iterable, Iterator, Optional, Sequence, Set, Union

import rospy
from shsa_msgs import msg

from shsa_core.dispatch import Table, table
from shsa_core.errors import ShsaError
from shsa_core.message_types import message_class
from shsa_core.model.field_value import Field, problem
from shsa_core.model.substitution import Substitution, row_key
from shsa_core.ros import clock, settings
from shsa_core.ros.inputs import Inputs
from shsa_core.ros.master import announce
from shsa_core.ros.master.node_api import FAILURES, Originals
from shsa_core.ros.messages.fields import read_message
from shsa_core.ros.messages.tables import TableSubscriber
from shsa_core.ros.node import LOG, recorded, run
from shsa_core.ros.outputs import Outputs
from shsa_core.ros.processes import priority
from shsa_core.ros.processes.heartbeats import HOST, MONITOR, Heart, hearer
from shsa_core.ros.trust import secret
from shsa_core.ros.trust.signing import SignedPublisher, Signing
from shsa_core.ros.wire import names
from shsa_core.ros.wire.rows import substitution_row
from shsa_core.ros.workers import UrgentFirst, Workers
from shsa_core.substitution import events, machine, sharing
from shsa_core.substitution.signals import JOURNAL, SHARED, VARIABLE, decode

USAGE = "usage: rosrun shsa_core substitute INPUTS CODE OUTPUT"


class SubstituteNode:
    """Brings events to the core, and carries out what it says.

    One thread handles events in order, and publishes. What waits for the master or for another node
    has threads of its own: a takeover needs neither. Without the secret of healing, as one that was
    started by hand, it takes no commands. `rests`: its priority while what it does does not matter.
    """

    def __init__(self, row: Substitution, rests: Optional[int] = None) -> None:
        threading.stack_size(settings.STACK_B)  # of those to come; ours stays as it is
        self._clock = clock.RobotClock()
        self._name = row.node
        self._row = row
        self._idle = row.idle
        self._listed: Set[str] = set()  # the keys of its rows in the table
        path = os.environ.get(secret.VARIABLE, "")
        self._signing = Signing(path, make=False) if path else None
        self._core: Union[machine.Substitute, sharing.Sharing] = (
            sharing.Sharing() if row.shared else machine.Substitute()
        )
        machine_name = "sharing" if row.shared else "substitution"
        journal = os.environ.get(JOURNAL, "")
        self._answer, self._close = recorded(journal, machine_name, {}, self._core.handle)
        self._inputs = Inputs(self._clock, rests)
        pause = settings.TURN_S if row.shared else settings.PAUSE_S
        self._registrations = UrgentFirst("registrations", pause)
        self._read(row)
        put = self._inputs.put
        self._host = os.environ.get(HOST, "")
        self._looks = Workers("looks")
        self._heart = Heart(hearer(self._host), self._looks)
        self._outputs = Outputs(
            lambda topic: put(events.Advertised(self._clock.now(), topic)),
            lambda topic, who: put(events.ConsumerJoined(self._clock.now(), topic, who)),
        )
        self._telling = Workers("telling")
        self._calls = Workers("calls")
        self._originals = Originals()
        register, inputs, outputs = self._registrations.put, self._inputs, self._outputs
        self._carry_out: Table[None] = table(
            events.Command,
            {
                events.Listen: lambda c: register(c.signal.topic, partial(inputs.listen, c.signal)),
                events.Overhear: lambda c: register(c.topic, partial(inputs.overhear, c)),
                events.Advertise: lambda c: register(c.topic, partial(outputs.advertise, c)),
                events.Withdraw: lambda c: register(c.topic, partial(outputs.withdraw, c.topic)),
                events.Compose: self._compose,
                events.Publish: self._publish,
                events.Remind: lambda c: self._calls.put(partial(self._remind, c.topics)),
                events.LookAtOriginal: lambda c: self._looks.put(partial(self._ask_original, c)),
                events.LookAtOthers: self._look_at_others,
                events.TakeOver: lambda c: self._changed(row_changed(self._clock.now(), c.row)),
                events.TellNoValue: self._tell_no_value,
                events.GiveUp: self._give_up,
                events.Log: lambda c: LOG[c.level]("%s: %s", self._name, c.text),
            },
        )

    def spin(self) -> None:
        """Follow the table of substitutions until ROS shuts down.

        Raises ShsaError if the core gives up.
        """
        try:
            self._follow()
        finally:
            self._close()

    def _follow(self) -> None:
        if not self._row.shared:
            self._feed(row_changed(self._clock.now(), self._row))
        if self._signing is not None:
            table_of = msg.Substitutions, self._table, self._signing, self._name
            TableSubscriber(names.SUBSTITUTIONS, *table_of)
            self._telling.put(self._failures)  # known before it has something to tell
            if self._row.idle and not self._row.shared:  # a first row may have come already
                checked = self._signing.checked(names.FAILURES, msg.Failure)
                hear = partial(self._signing.subscribe, names.FAILURES, checked)
                self._telling.put(lambda: hear(self._failed))
        reach = False, False
        while not rospy.is_shutdown():
            wait = min(settings.TURN_S, self._core.next_deadline - self._clock.now())
            self._inputs.wait(max(wait, settings.REST_S) if clock.is_simulated() else wait)
            self._heart.beat()
            before, heart = reach, self._heart
            reach = heart.cut_off, heart.unheard > settings.LONGEST_PAUSE_S
            if reach != before:
                self._feed(events.ReachChanged(self._clock.now(), *reach))
            for event in self._inputs.take(self._clock.now() >= self._core.reads_at):
                self._feed(event)
            self._inputs.hurry(self._core.hurries)
            if self._clock.now() >= self._core.next_deadline:
                self._feed(events.Tick(self._clock.now(), self._heart.unheard))

    def _feed(self, event: events.Event) -> None:
        for command in self._answer(event):
            self._carry_out[type(command)](command)

    # Events, from rospy's threads.

    def _table(self, message: msg.Substitutions) -> None:
        """Tell what a table changes of its rows, and if it is idle of the plans."""
        now = self._clock.now()
        ours = [row for row in message.substitutions if row.node == self._name]
        for row in _rows(ours):
            self._listed.add(row_key(row))
            self._idle = row.idle
            self._changed(row_changed(now, row))
        told = {row_key(row) for row in ours}
        ended = self._listed.intersection(message.removed) - told
        for key in (self._listed - told) if message.whole else ended:
            self._listed.discard(key)
            self._inputs.put(events.RowRemoved(now, key.partition(" ")[2], key in ended))
        if self._idle:
            plans = tuple(_rows(row for row in message.substitutions if not row.node))
            problems = tuple(each for plan in plans for each in unusable(plan))
            changed = tuple(message.removed), message.whole, problems
            self._inputs.put(events.PlansChanged(now, plans, *changed))

    def _changed(self, event: events.RowChanged) -> None:
        if not event.row.idle:
            self._read(event.row)
        self._inputs.put(event)

    def _read(self, row: Substitution) -> None:
        """Have the inputs of a program read, and its topics registered first if it matters now."""
        topics = [signal.topic for signal in row.inputs]
        self._inputs.read(topics)
        if row.publishing or not row.shared:
            self._registrations.urge((*topics, *row.topics))

    def _failed(self, failure: msg.Failure) -> None:
        told = failure.topic, failure.kind, bytes(failure.last_message)
        self._inputs.put(events.FailureHeard(self._clock.now(), *told))

    # Commands.

    @cached_property
    def _to_monitor(self) -> Heart:
        """Beats to the monitor: only who fills in need know whether it is there."""
        return Heart(MONITOR)

    def _look_at_others(self, look: events.LookAtOthers) -> None:
        stands = self._inputs.stands(look.topic, look.publisher)
        healers = [self._heart] if self._host else [self._heart, self._to_monitor]
        alone = not all([each.beat(at_once=True) for each in healers])
        self._inputs.put(events.OthersStand(self._clock.now(), look, stands, alone))

    def _give_up(self, command: events.GiveUp) -> None:
        raise ShsaError(command.reason)

    def _compose(self, command: events.Compose) -> None:
        if command.overheard:
            heard = self._inputs.last(command.topic) or command.last_message
            command = replace(command, last_message=heard)
        self._outputs.compose(command)

    def _publish(self, command: events.Publish) -> None:
        try:
            self._outputs.publish(command)
        except (ShsaError, rospy.ROSSerializationException) as error:
            # A value that the message cannot hold is no value.
            topic = command.outputs[0].topic
            rospy.logwarn_throttle_identical(10.0, f"{self._name}: {topic}: {error}")

    def _remind(self, topics: Sequence[str]) -> None:
        try:
            announce.remind(topics, self._outputs.connected)
        except FAILURES as error:
            text = "%s: telling the subscribers of %s who publishes them: %s"
            rospy.logwarn(text, self._name, ", ".join(topics), error)

    def _ask_original(self, look: events.LookAtOriginal) -> None:
        served = self._originals.served_consumers(look.topic, look.original)
        self._inputs.put(events.OriginalServes(self._clock.now(), look, served))

    def _tell_no_value(self, command: events.TellNoValue) -> None:
        if self._signing is None:
            return  # nobody would believe it
        failure = msg.Failure(
            service=command.service,
            topic=command.topic,
            publisher=self._name,
            kind=msg.Failure.NO_VALUE,
            detail="the program has no value now",
        )
        failure.header.stamp = rospy.Time.now()
        self._telling.put(lambda: self._failures()(failure))

    @lru_cache(maxsize=None)
    def _failures(self) -> Callable[[msg.Failure], None]:
        """Return what publishes its failures; made once, where it may wait for the master."""
        assert self._signing is not None
        return SignedPublisher(self._signing, names.FAILURES, msg.Failure).publish


def _rows(messages: Iterable[msg.Substitution]) -> Iterator[Substitution]:
    """Yield the rows of a table; one that is none costs no other."""
    for each in messages:
        try:
            yield substitution_row(each)
        except ShsaError as error:
            text = f"A row for {each.service} is refused: {error}"
            rospy.logwarn_throttle_identical(60.0, text)


def row_changed(now: float, row: Substitution) -> events.RowChanged:
    """Return the event of a row that is new, or another one than before."""
    return events.RowChanged(now, row, unusable(row), last_message(row), clock.ros_ns())


def unusable(row: Substitution) -> events.Unusable:
    """Return the signals of a row that cannot be read or written here, each with the reason."""
    problems = [(each, problem(each.type, each.field, False)) for each in row.inputs]
    problems += [(each, problem(each.type, each.field, True)) for each in row.outputs]
    return tuple((signal, why) for signal, why in problems if why)


def last_message(row: Substitution) -> Optional[events.LastMessage]:
    """Return what the last good message of a row held; None if there is none to be read."""
    if not row.last_message or not row.outputs:
        return None
    try:
        kind = message_class(row.outputs[0].type)
        message = read_message(kind, row.last_message)
        found = ((each.field, Field(kind, each.field).get(message)) for each in row.outputs)
        values = tuple((field, value) for field, value in found if value is not None)
    except ShsaError as error:
        text = f"{row.node}: the last message of {row.service} is not used: {error}"
        rospy.logwarn_throttle_identical(60.0, text)
        return None
    stamp = message.header.stamp.to_nsec() if kind._has_header else 0
    return events.LastMessage(values, min(stamp, clock.ros_ns()))


def _row(inputs: str, code: str, outputs: str) -> Substitution:
    """Return the row of three strings, muted at first unless somebody has started it by hand."""
    ends = ([path.strip() for path in end.split(",")] for end in (inputs, outputs))
    paths = [[path for path in end if path] for end in ends]
    text = os.environ.get(VARIABLE)
    if text is not None:
        signals = decode(text)
        if [[signal.path for signal in each] for each in signals] != paths:
            raise ShsaError(f"{VARIABLE} does not hold the signals of INPUTS and OUTPUT")
        return Substitution(rospy.get_name(), "", signals[0], code, signals[1])
    # Not for those who ask nobody: it takes long.
    from shsa_core.ros.master.som_parameter import look_up

    found = map(look_up, paths)
    muted = bool(rospy.get_param("~muted", False))
    return Substitution(rospy.get_name(), "", next(found), code, next(found), publishing=not muted)


def main() -> None:
    """Run the node: three strings on the command line.

    `~muted` starts it muted; the environment's SHSA_JOURNAL is a file for every event.
    """
    arguments = rospy.myargv(sys.argv)[1:]
    if len(arguments) != 3:
        raise SystemExit(USAGE)
    rests = priority.USUAL if VARIABLE in os.environ else None
    run("substitute", lambda: SubstituteNode(_row(*arguments), rests).spin())


def standby() -> None:
    """Run an idle substitute, to be given its program by its row.

    With `--shared`, by its rows: it holds several.
    """
    shared = SHARED in rospy.myargv(sys.argv)[1:]
    priority.set_all(priority.STANDS_BY)
    row = lambda: Substitution(rospy.get_name(), "", (), "", (), shared=shared)
    run("standby", lambda: SubstituteNode(row(), priority.STANDS_BY).spin())

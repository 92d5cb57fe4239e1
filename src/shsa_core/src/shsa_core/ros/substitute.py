"""The substitute: a node made of three strings that takes over a topic (Section V-A3)."""
import functools
import os
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Callable, Optional, Union

import rospy
from shsa_msgs import msg

from shsa_core.dispatch import Table, table
from shsa_core.errors import ShsaError
from shsa_core.model.substitution import Substitution
from shsa_core.ros import clock, settings
from shsa_core.ros.inputs import Inputs
from shsa_core.ros.master import announce
from shsa_core.ros.master.bus import Originals
from shsa_core.ros.master.node_api import FAILURES
from shsa_core.ros.messages.tables import TableSubscriber
from shsa_core.ros.node import LOG
from shsa_core.ros.outputs import Outputs
from shsa_core.ros.processes.heartbeats import HOST, MONITOR, Heart, hearer, hears
from shsa_core.ros.row_reader import RowReader, last_message, unusable
from shsa_core.ros.trust import secret
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.wire import names
from shsa_core.ros.workers import Workers
from shsa_core.substitution import events, machine, sharing

if TYPE_CHECKING:
    from shsa_core.journal.writer import JournalWriter


class SubstituteNode:
    """Brings events to the core, and carries out what it says.

    One thread handles events in order, and publishes. What waits for the master or for another node
    has threads of its own: a takeover needs neither. Without the secret of healing, as one that was
    started by hand, it takes no commands. `rests`: its priority while what it does does not matter.
    """

    def __init__(
        self,
        row: Substitution,
        journal: Optional["JournalWriter"] = None,
        rests: Optional[int] = None,
    ) -> None:
        self._clock = clock.RobotClock()
        self._name = row.node
        self._row = row
        self._rows = RowReader(row.node, row.idle)
        self._hurry = threading.Event()
        path = os.environ.get(secret.VARIABLE, "")
        self._signing = Signing(path, make=False) if path else None
        self._core: Union[machine.Substitute, sharing.Sharing] = (
            sharing.Sharing() if row.shared else machine.Substitute()
        )
        handle = self._core.handle
        self._journal, self._answer = journal, journal.recorded(handle) if journal else handle
        self._inputs = Inputs(row.node, self._clock, rests)
        self._inputs.read(signal.topic for signal in row.inputs)
        put = self._inputs.put
        self._host = os.environ.get(HOST, "")
        self._heart = Heart(hearer(self._host))
        self._outputs = Outputs(
            lambda topic: put(events.Advertised(self._clock.now(), topic)),
            lambda topic, who: put(events.ConsumerJoined(self._clock.now(), topic, who)),
        )
        self._registrations = Workers("registrations")
        self._telling = Workers("telling")
        self._calls = Workers("calls")
        self._looks = Workers("looks")
        self._originals = Originals()
        self._carry_out: Table[None] = table(
            events.Command,
            {
                events.Listen: self._listen,
                events.Overhear: lambda c: self._register(
                    lambda: self._inputs.overhear(c.topic, c.type)
                ),
                events.Advertise: lambda c: self._register(
                    lambda: self._outputs.advertise(c.topic, c.type, c.latched)
                ),
                events.Withdraw: lambda c: self._registrations.put(
                    lambda: self._outputs.withdraw(c.topics)
                ),
                events.Compose: self._compose,
                events.Publish: self._publish,
                events.Announce: self._announce,
                events.Remind: self._remind,
                events.LookAtOriginal: self._look_at_original,
                events.LookAtOthers: self._look_at_others,
                events.LookAtHealer: self._look_at_healer,
                events.TakeOver: self._take_over,
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
            if self._journal is not None:
                self._journal.close()

    def _follow(self) -> None:
        if not self._row.shared:
            row, time, ros_time = self._row, self._clock.now(), clock.ros_ns()
            self._feed(events.RowChanged(time, row, unusable(row), ros_time=ros_time))
        if self._signing is not None:
            table_of = msg.Substitutions, self._table, self._signing, self._name
            TableSubscriber(names.SUBSTITUTIONS, *table_of)
            self._telling.put(self._failures)  # known before it has something to tell
            if self._rows.idle and not self._row.shared:
                checked = self._signing.checked(names.FAILURES, msg.Failure)
                hear = functools.partial(self._signing.subscribe, names.FAILURES, checked)
                self._telling.put(lambda: hear(self._failed))
        alone = cut_off = False
        while not rospy.is_shutdown():
            wait = min(settings.TURN_S, self._core.next_deadline - self._clock.now())
            self._inputs.wait(max(wait, settings.REST_S) if clock.is_simulated() else wait)
            self._heart.beat()
            if self._heart.cut_off is not cut_off:
                cut_off = not cut_off
                self._feed(events.ReachChanged(self._clock.now(), cut_off))
            if self._heart.unheard > settings.ALONE_S and not alone:
                self._feed(events.LeftAlone(self._clock.now()))
            alone = self._heart.unheard > settings.ALONE_S
            for event in self._inputs.take(self._clock.now() >= self._core.reads_at):
                self._feed(event)
            self._inputs.hurry(self._core.hurries)
            if self._clock.now() >= self._core.next_deadline:
                self._feed(events.Tick(self._clock.now()))

    def _feed(self, event: events.Event) -> None:
        for command in self._answer(event):
            self._carry_out[type(command)](command)

    # Events, from rospy's threads.

    def _table(self, message: msg.Substitutions) -> None:
        for event in self._rows.read(message, self._clock.now()):
            self._changed(event)

    def _changed(self, event: events.Event) -> None:
        if isinstance(event, events.RowChanged) and not event.row.idle:
            row = event.row
            self._inputs.read(signal.topic for signal in row.inputs)
            if row.publishing or not row.shared:
                self._hurry.set()
        self._inputs.put(event)

    def _failed(self, failure: msg.Failure) -> None:
        if failure.kind == msg.Failure.NODE_GONE:
            last = bytes(failure.last_message)
            self._inputs.put(events.NodeGone(self._clock.now(), failure.topic, last))

    # Commands.

    def _listen(self, command: events.Listen) -> None:
        for signal in command.inputs:
            self._register(functools.partial(self._inputs.listen, signal))

    def _look_at_others(self, look: events.LookAtOthers) -> None:
        stands = self._inputs.stands(look.topic, look.publisher)
        alone = not self._heart.beat(at_once=True) or not (self._host or hears(MONITOR))
        self._inputs.put(events.OthersStand(self._clock.now(), look, stands, alone))

    def _look_at_healer(self, _: events.LookAtHealer) -> None:
        self._heart.beat(at_once=True)
        ago = time.monotonic() - self._heart.answered
        self._inputs.put(events.HealerHeard(self._clock.now(), ago))

    def _take_over(self, command: events.TakeOver) -> None:
        row, now = command.row, self._clock.now()
        last, ros_time = last_message(row), clock.ros_ns()
        self._changed(events.RowChanged(now, row, unusable(row), last, ros_time))

    def _compose(self, command: events.Compose) -> None:
        if command.overheard:
            heard = self._inputs.last(command.topic) or command.last_message
            command = replace(command, last_message=heard)
        self._outputs.compose(command)

    def _register(self, call: Callable[[], None]) -> None:
        """Make a call to the master; who is in no hurry makes room for others after it."""
        self._registrations.put(call)
        if self._rows.idle or self._row.shared:
            pause = settings.TURN_S if self._row.shared else settings.PAUSE_S
            self._registrations.put(lambda: self._hurry.wait(pause))

    def _publish(self, command: events.Publish) -> None:
        try:
            self._outputs.publish(command)
        except (ShsaError, rospy.ROSSerializationException) as error:
            # A value that the message cannot hold is no value.
            topic = command.outputs[0].topic
            rospy.logwarn_throttle_identical(10.0, f"{self._name}: {topic}: {error}")

    def _announce(self, command: events.Announce) -> None:
        self._call(
            f"announcing {command.topic}",
            lambda: announce.announce(command.topic, command.type),
        )

    def _remind(self, command: events.Remind) -> None:
        self._call(
            f"telling the subscribers of {', '.join(command.topics)} who publishes them",
            lambda: announce.remind(command.topics, self._outputs.connected),
        )

    def _call(self, what: str, call: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                call()
            except FAILURES as error:
                rospy.logwarn("%s: %s: %s", self._name, what, error)

        self._calls.put(guarded)

    def _look_at_original(self, look: events.LookAtOriginal) -> None:
        def call() -> None:
            served = self._originals.served_consumers(look.topic, look.original)
            up, consumers = served is not None, served or frozenset()
            self._inputs.put(events.OriginalServes(self._clock.now(), look, consumers, up))

        self._looks.put(call)

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

    @functools.lru_cache(maxsize=None)
    def _failures(self) -> Callable[[msg.Failure], None]:
        """Return what publishes its failures; made once, where it may wait for the master."""
        assert self._signing is not None
        sign = self._signing.signer(names.FAILURES, msg.Failure)
        publisher = rospy.Publisher(names.FAILURES, msg.Failure, queue_size=10)
        return lambda failure: publisher.publish(sign(failure))

    def _give_up(self, command: events.GiveUp) -> None:
        raise ShsaError(command.reason)

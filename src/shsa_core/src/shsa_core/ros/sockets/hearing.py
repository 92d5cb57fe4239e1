"""What a substitute hears: what it computes from, and what others publish on its topics.

The messages come as the bytes that were sent, straight from the sockets (`connections`). Muted, a
substitute needs few of them: one is decoded once somebody reads it.
"""
from typing import Callable, Dict, Iterable, List, NamedTuple, Optional, Set, Tuple, Union

import rospy

from shsa_core.errors import ShsaError
from shsa_core.model.service import Signal
from shsa_core.ros.sockets.arrival_times import ArrivalTimes
from shsa_core.ros.sockets.connections import Arrived, Connections, Happening, Lost, Made, Closed
from shsa_core.ros.sockets.identities import Identified
from shsa_core.ros.sockets.inbox import Inbox
from shsa_core.ros.messages.messages import Decoder, stamp
from shsa_core.ros.sockets.reconnection import Answered
from shsa_core.ros.sockets.stream import Connection
from shsa_core.substitution.events import InputArrived, OtherGone, OtherHeard

RECONNECT_S = 2.0
"""A publisher whose connection was lost counts as gone if it gives no other one within this."""

OfConnections = Union[Made, Closed, Answered, Identified]
OF_CONNECTIONS = (Made, Closed, Answered, Identified)
"""What comes to the inbox for `Hearing.heed`."""


class Message(NamedTuple):
    """A message, and when it had come: `time` in s, `ros_time` in ns."""

    connection: Connection
    data: bytes
    time: float
    ros_time: int


class Hearing:
    """The connections of a substitute, `name`, to the publishers of its topics.

    `listen` and `overhear` wait for the master, and are for one thread; all else is for the one
    that reads `inbox`, which is woken by a message of a topic that `wakes`. `times` were looked at
    before each `read`.
    """

    def __init__(
        self, name: str, inbox: Inbox, times: ArrivalTimes, wakes: Callable[[str], bool]
    ) -> None:
        self._name, self._times = name, times
        self._connections = Connections(inbox, RECONNECT_S, _refused, wakes)
        self._topics: Set[str] = set()
        self._kinds: Dict[str, str] = {}
        self._fields: Dict[str, Tuple[str, ...]] = {}
        self._decoders: Dict[Connection, Tuple[Tuple[str, ...], Optional[Decoder]]] = {}
        self._overheard: Set[str] = set()
        self._last: Dict[str, bytes] = {}

    def listen(self, signal: Signal) -> None:
        """Hear a field of a topic; what was subscribed once stays so."""
        fields = self._fields.get(signal.topic, ())
        if signal.field not in fields:
            self._fields[signal.topic] = (*fields, signal.field)
        self._subscribe(signal.topic, signal.type)

    def overhear(self, topic: str, kind: str) -> None:
        """Hear what others publish on a topic."""
        self._overheard.add(topic)
        self._subscribe(topic, kind)

    def _subscribe(self, topic: str, kind: str) -> None:
        if topic not in self._topics:
            self._topics.add(topic)
            self._kinds[topic] = kind
            self._connections.subscribe(topic)

    def wake(self) -> None:
        """Ask again of each topic whether it `wakes`."""
        self._connections.wake()

    @property
    def waits(self) -> bool:
        """Whether there are connections that wake nobody, and are to be read all the same."""
        return self._connections.waits

    def read(self, items: Iterable[OfConnections], ready: Set[int]) -> List[Happening]:
        """What has happened at the connections, and come on the descriptors that are `ready`."""
        happenings = [each for item in items for each in self._connections.heed(item)]
        return [*happenings, *self._connections.read(ready)]

    def message(self, arrived: Arrived) -> Message:
        """What was read."""
        return Message(arrived.connection, arrived.data, *self._times.of(arrived.noted))

    def is_input(self, message: Message) -> bool:
        """Whether it is of a topic of which fields are heard."""
        return message.connection.topic in self._fields

    def input(self, message: Message) -> Optional[InputArrived]:
        """The fields of a message; None if it cannot be read, and a warning."""
        connection, data, time, ros_time = message
        topic, publisher = connection.topic, connection.publisher
        fields = self._fields[topic]
        decoder = self._decoder(connection, fields)
        try:
            values = () if decoder is None else decoder.values(data)
        except ShsaError as error:
            _say_unread(topic, publisher, error)
            return None
        if decoder is None:
            return None
        known = tuple((name, each) for name, each in zip(fields, values) if each is not None)
        stamped = stamp(data) if decoder.has_stamp else 0
        return InputArrived(time, topic, publisher, known, stamped, ros_time)

    def other(self, message: Message) -> Optional[OtherHeard]:
        """That somebody else has published on a topic that is overheard; None if it is no such."""
        connection, data, time, ros_time = message
        topic, publisher = connection.topic, connection.publisher
        if topic not in self._overheard or publisher == self._name:
            return None
        decoder = self._decoder(connection, self._fields.get(topic, ()))
        if decoder is None:
            return None
        self._last[topic] = data
        stamped = min(stamp(data), ros_time) if decoder.has_stamp else 0
        return OtherHeard(time, topic, publisher, stamped)

    def gone(self, lost: Lost) -> Optional[OtherGone]:
        """That the node of somebody else on a topic that is overheard is gone; None if not so."""
        if lost.topic not in self._overheard or lost.publisher == self._name:
            return None
        return OtherGone(self._times.of(0)[0], lost.topic, lost.publisher)

    def is_overheard(self, topic: str) -> bool:
        """Whether others are heard on a topic."""
        return topic in self._overheard

    def last(self, topic: str) -> bytes:
        """The last message of another one on a topic, serialized; empty: there is none."""
        return self._last.get(topic, b"")

    def stands(self, topic: str, publisher: str) -> bool:
        """Whether a connection to a publisher stands."""
        return publisher in self._connections.publishers(topic)

    def _decoder(self, connection: Connection, fields: Tuple[str, ...]) -> Optional[Decoder]:
        """What reads a publisher's messages; None if they are of another type, and a warning."""
        known = self._decoders.get(connection)
        if known is not None and known[0] == fields:
            return known[1]
        topic, publisher = connection.topic, connection.publisher
        decoder: Optional[Decoder] = None
        try:
            decoder = Decoder(self._kinds[topic], connection.header, fields)
        except ShsaError as error:
            _say_unread(topic, publisher, error)
        standing = self._connections.standing()
        self._decoders = {each: of for each, of in self._decoders.items() if each in standing}
        self._decoders[connection] = fields, decoder
        return decoder


def _say_unread(topic: str, publisher: str, error: ShsaError) -> None:
    """Say that messages are not read, now and then."""
    text = f"What {publisher} publishes on {topic} is not read: {error}"
    rospy.logwarn_throttle_identical(60.0, text)


def _refused(topic: str, claim: str, why: str) -> None:
    text = f"Who calls itself {claim} on {topic} is not heard as that: {why}"
    rospy.logwarn_throttle_identical(60.0, text)

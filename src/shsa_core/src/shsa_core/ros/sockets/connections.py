"""The connections to the publishers of topics, read by one thread of our own.

rospy makes the connections, each in a thread that then reads and calls back. Here that thread ends
when the connection stands, and whoever calls `read` gets the messages straight from the sockets:
what the kernel has received by then is handled before anybody is judged, and a connection that ends
is seen after its last message, when it ends. Whether its node has gone then, `reconnection` tells.

What a connection calls itself is a claim. It counts for a node once the master has said that this
node is at the address that we connected to; until then what comes is read and dropped, save the
newest message, so that nobody who publishes is held up.
"""
import weakref
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, Iterator, List, NamedTuple, Set, Tuple, Union

import rospy
from rospy.impl.registration import Registration, get_topic_manager
from rospy.topics import _SubscriberImpl

from shsa_core.ros import clock
from shsa_core.ros.sockets import arrival_times
from shsa_core.ros.rospy_patches.bounds import bound_header
from shsa_core.ros.sockets.claims import Claims, Recognized
from shsa_core.ros.sockets.identities import Identified
from shsa_core.ros.sockets.inbox import Inbox
from shsa_core.ros.sockets.reconnection import Answered, Reconnection
from shsa_core.ros.sockets.stream import Connection
from shsa_core.ros.sockets.waking import Waking

TRIES = 3
"""So often a connection that never stood is asked for again."""


class Made(NamedTuple):
    """rospy has made a connection and read its header."""

    topic: str
    transport: Any


class Closed(NamedTuple):
    """rospy has closed a connection."""

    topic: str
    transport: Any


class Connected(NamedTuple):
    """The first connection to a publisher of a topic stands, or one after an interruption."""

    topic: str
    publisher: str


class Interrupted(NamedTuple):
    """The last connection to a publisher was lost, but its node lives.

    Connected or Lost follows soon.
    """

    topic: str
    publisher: str


class Lost(NamedTuple):
    """A publisher of a topic is gone: its node, or what it offered."""

    topic: str
    publisher: str


class Arrived(NamedTuple):
    """A message has come; `whole`: its data is all of it, and not only what was wanted.

    `noted`: when it had come; 0: at the last look.
    """

    connection: Connection
    data: bytes
    whole: bool
    noted: int = 0


Happening = Union[Connected, Interrupted, Lost, Arrived]


@dataclass
class _Doubt:
    """A publisher that is not connected any more, and may be gone; empty: it never was connected.

    `until`: when it is taken to be gone. `asked`: the number under which it was asked for another
    connection, 0: it was not; it may not have answered yet (`waits`).
    """

    publisher: str
    until: float
    address: str = ""
    asked: int = 0
    waits: bool = False


class _Implementation(_SubscriberImpl):
    """rospy's side of a subscription, which hands its connections over."""

    def __init__(self, topic: str, inbox: Inbox) -> None:
        super().__init__(topic, rospy.AnyMsg)
        self.set_tcp_nodelay(True)
        self._topic, self._inbox = topic, inbox

    def add_connection(self, transport: Any) -> bool:
        """Called by rospy for every new connection; it may replace one to the same publisher."""
        topic, inbox = self._topic, self._inbox
        bound_header(transport)
        # What rospy drops while it connects must be freed, and so closed, at once: a connection
        # that stays without a header keeps a rospy publisher from serving anybody else. So it may
        # not hold itself.
        weak = weakref.ref(transport)
        transport.receive_loop = lambda callback: inbox.put(Made(topic, weak()))
        transport.set_cleanup_callback(lambda closing: inbox.put(Closed(topic, closing)))
        return bool(super().add_connection(transport))

    def connects(self, uri: str) -> bool:
        """Whether a connection to the node at `uri` stands or is under way."""
        with self.c_lock:
            return any(each.endpoint_id == uri for each in self.connections)


class Connections:
    """The connections of every subscribed topic.

    All methods are for one thread, the one that reads `inbox`. A node that listens, and for
    `reconnect` s neither gives another connection nor refuses it, counts as gone. `refused(topic,
    claim, why)` is called for who is not whom it calls itself. On a topic that `wakes`, what comes
    wakes the reader of `inbox`.
    """

    def __init__(
        self,
        inbox: Inbox,
        reconnect: float,
        refused: Callable[[str, str, str], None],
        wakes: Callable[[str], bool] = lambda topic: True,
    ) -> None:
        self._inbox, self._reconnect = inbox, reconnect
        self._waking = Waking(inbox, wakes)
        self._claims = Claims(inbox, refused)
        self._implementations: Dict[str, _Implementation] = {}
        self._subscribers: Dict[str, rospy.Subscriber] = {}
        self._standing: Dict[int, Connection] = {}
        self._new: Set[int] = set()
        self._expecting: Set[int] = set()  # who is read whether it is ready or not
        self._doubts: Dict[Tuple[str, str], _Doubt] = {}
        self._tries: Dict[Tuple[str, str], int] = {}
        self._reconnection = Reconnection(inbox)
        self._asked = 0

    def subscribe(self, topic: str) -> None:
        """Subscribe `topic`; waits for the master. This alone may be called from another thread."""
        manager = get_topic_manager()
        implementation = self._implementations[topic] = _Implementation(topic, self._inbox)
        with manager.lock:
            manager._add(implementation, manager.subs, Registration.SUB)
            self._subscribers[topic] = rospy.Subscriber(topic, rospy.AnyMsg)

    def unsubscribe(self, topic: str) -> None:
        """End the subscription of `topic` and its connections."""
        del self._implementations[topic]
        self._subscribers.pop(topic).unregister()
        for connection in list(self._standing.values()):
            if connection.topic == topic:
                self._forget(connection)
                self._claims.drop(connection.descriptor)
        self._doubts = {key: doubt for key, doubt in self._doubts.items() if key[0] != topic}
        self._tries = {key: tries for key, tries in self._tries.items() if key[0] != topic}

    def wake(self) -> None:
        """Ask again of each topic whether it wakes."""
        self._waking.ask(self._standing.values())

    @property
    def waits(self) -> bool:
        """Whether there are connections that wake nobody, and are to be read all the same."""
        return self._waking.waits

    def standing(self) -> Set[Connection]:
        """The connections that stand, or did until what has not been heeded yet."""
        return set(self._standing.values())

    def heed(self, item: Union[Made, Closed, Answered, Identified]) -> Iterator[Happening]:
        """What follows from what rospy did, or from what a node answered."""
        if item.topic not in self._implementations:
            return
        if isinstance(item, Answered):
            yield from self._answered(item)
        elif isinstance(item, Identified):
            for recognized in self._claims.answered(item, clock.now()):
                yield from self._recognize(recognized)
        elif isinstance(item, Made):
            yield from self._take_over(item.topic, item.transport)
        else:
            for connection in list(self._standing.values()):
                if connection.transport is item.transport:
                    yield from self._lose(connection)
            uri = item.transport.endpoint_id
            if (item.topic, uri) in self._doubts:
                yield from self._settle(item.topic, uri)
            elif not item.transport.header:
                self._try_again(item.topic, uri)

    def read(self, ready: Set[int]) -> List[Happening]:
        """What has come on the descriptors that are ready, and on new connections.

        And where more was expected than has come.
        """
        ready, self._new = ready | self._new | self._expecting, set()
        self._claims.ask_again(clock.now())
        return [*self._read(ready), *self._give_up()]

    def _read(self, ready: Set[int]) -> Iterator[Happening]:
        for descriptor in ready:
            connection = self._standing.get(descriptor)
            if connection is None:
                continue
            stands = connection.read()
            self._waking.was_read(connection)
            (self._expecting.add if connection.expects > 1 else self._expecting.discard)(descriptor)
            for frame in connection.frames.take():
                if descriptor in self._claims:
                    self._claims.put_aside(descriptor, frame.data)
                else:
                    yield Arrived(connection, *frame)
            if not stands:
                connection.transport.close()
                yield from self._lose(connection)

    def _take_over(self, topic: str, transport: Any) -> Iterator[Happening]:
        socket = transport.socket
        if transport.done or socket is None:
            return
        publisher, descriptor = transport.callerid_pub, socket.fileno()
        try:
            socket.setblocking(False)
            arrival_times.note(socket)
        except OSError:
            return  # rospy has closed it in a thread of its own, which we are told next
        connection = Connection(
            topic, publisher, transport.header, transport, descriptor, _address(socket)
        )
        connection.frames.add(transport.read_buff.getvalue())
        if descriptor in self._standing:
            yield from self._lose(self._standing[descriptor])
        self._standing[descriptor] = connection
        self._new.add(descriptor)
        self._waking.add(connection)
        for recognized in self._claims.take(connection):
            yield from self._recognize(recognized)

    def _recognize(self, recognized: Recognized) -> Iterator[Happening]:
        """A connection is a node's: what comes from now on counts."""
        connection = recognized.connection
        topic, publisher = connection.topic, connection.publisher
        others = (each for each in self._standing.values() if each is not connection)
        if publisher not in self._known_publishers(topic, others):
            yield Connected(topic, publisher)
        key = topic, connection.transport.endpoint_id
        self._doubts.pop(key, None)
        self._tries.pop(key, None)
        if recognized.newest is not None:
            yield Arrived(connection, recognized.newest, True)

    def _lose(self, connection: Connection) -> Iterator[Happening]:
        """A connection has ended; its publisher may be connected otherwise, or again soon."""
        self._forget(connection)
        topic, publisher = connection.topic, connection.publisher
        uri, until = connection.transport.endpoint_id, clock.now() + self._reconnect
        if self._claims.drop(connection.descriptor):
            self._try_again(topic, uri)
            return
        if publisher in self.publishers(topic):
            return
        self._doubts[topic, uri] = _Doubt(publisher, until, connection.address)
        happenings = list(self._settle(topic, uri))
        yield from happenings or [Interrupted(topic, publisher)]

    def _forget(self, connection: Connection) -> None:
        del self._standing[connection.descriptor]
        self._expecting.discard(connection.descriptor)
        self._waking.drop(connection)

    def _settle(self, topic: str, uri: str) -> Iterator[Happening]:
        """See whether a publisher in doubt is gone, or else ask it for a connection, once."""
        doubt = self._doubts[topic, uri]
        implementation = self._implementation(topic)
        if doubt.waits or implementation.connects(uri):
            return
        if not doubt.asked and not self._reconnection.is_gone(doubt.address, uri):
            self._asked += 1
            doubt.asked, doubt.waits = self._asked, True
            self._reconnection.ask(topic, uri, implementation, doubt.asked)
            return
        yield from self._end_doubt(topic, uri)

    def _answered(self, item: Answered) -> Iterator[Happening]:
        doubt = self._doubts.get((item.topic, item.uri))
        if doubt is not None and doubt.asked == item.number:  # and not of a doubt before this one
            doubt.waits = False
            if not item.willing:
                self._tries[item.topic, item.uri] = TRIES
            yield from self._settle(item.topic, item.uri)

    def _give_up(self) -> Iterator[Happening]:
        """Those who were in doubt for too long are gone."""
        if self._doubts:
            now = clock.now()
            for key in [key for key, doubt in self._doubts.items() if doubt.until <= now]:
                yield from self._end_doubt(*key)

    def _end_doubt(self, topic: str, uri: str) -> Iterator[Happening]:
        publisher = self._doubts.pop((topic, uri)).publisher
        if not publisher:
            self._try_again(topic, uri)
        elif publisher not in self.publishers(topic):
            self._claims.forget(publisher, uri)
            yield Lost(topic, publisher)

    def _try_again(self, topic: str, uri: str) -> None:
        """A connection was closed before it stood: nobody else would ask for another one."""
        tries = self._tries.get((topic, uri), 0)
        implementation = self._implementation(topic)
        if tries < TRIES and not implementation.connects(uri):
            self._tries[topic, uri] = tries + 1
            self._doubts[topic, uri] = _Doubt("", clock.now() + self._reconnect)
            for _ in self._settle(topic, uri):
                pass

    def _implementation(self, topic: str) -> _Implementation:
        return self._implementations[topic]

    def publishers(self, topic: str) -> Set[str]:
        """Who publishes a topic, by the connections that stand."""
        return self._known_publishers(topic, self._standing.values())

    def _known_publishers(self, topic: str, among: Iterable[Connection]) -> Set[str]:
        of_topic = (each for each in among if each.topic == topic)
        return {each.publisher for each in of_topic if each.descriptor not in self._claims}


def _address(connected: Any) -> str:
    """The address of the other end; empty if it has gone already."""
    try:
        return str(connected.getpeername()[0])
    except OSError:
        return ""

"""Subscriptions that one thread reads: who connects, who is gone, and every message.

rospy makes the connections. Its thread ends when one stands, and whoever calls `read` gets the
messages straight from the sockets: what the kernel has received by then is handled before anybody
is judged. Until `caller_ids` knows whose a connection is, what comes is read and dropped, save the
newest message. Whether a node whose connection has ended is gone, `reconnection` tells.
"""
import os
import select
from collections import deque
from contextlib import suppress
from functools import partial
from typing import Any, Callable, Deque, Dict, Iterable, Iterator, List, NamedTuple, Optional, Set
from typing import Tuple, Union

from shsa_core.monitoring.events import Connected, Disconnected, Interrupted, Tick
from shsa_core.ros import clock
from shsa_core.ros.rospy_patches.subscribing import HandedOver
from shsa_core.ros.sockets.caller_ids import CallerIds
from shsa_core.ros.sockets.connection import ArrivalTimes, Connection
from shsa_core.ros.sockets.reconnection import Doubt, Reconnection

READABLE = select.EPOLLIN | select.EPOLLRDHUP


class Inbox:
    """Waits on the monotonic clock: a jump of the wall clock neither wakes nor holds its reader.

    By `select`: `epoll.poll(timeout)` rounds up to whole ms, which is too long at 1 kHz.
    """

    def __init__(self) -> None:
        self._items: Deque[Any] = deque()
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._reader, False)
        self._readable, self._waking, self._hung_up = (select.epoll() for _ in range(3))
        self._waking.register(self._reader, select.EPOLLIN)
        self._woken = False

    def put(self, item: Any) -> None:
        """Add an item and wake the reader; from any thread."""
        self._items.append(item)
        self.wake()

    def wake(self) -> None:
        """End the reader's sleep, or its next one; from any thread."""
        if not self._woken:
            self._woken = True
            os.write(self._writer, b"!")

    def watch(self, descriptor: int) -> None:
        """Wait for this descriptor as well, until it is closed."""
        self._readable.register(descriptor, READABLE)
        self._waking.register(descriptor, READABLE)
        self._hung_up.register(descriptor, select.EPOLLRDHUP)

    def watch_otherwise(self, descriptor: int, wakes: bool) -> None:
        """Have a watched descriptor wake from now on, or not until its end."""
        self._waking.modify(descriptor, READABLE if wakes else select.EPOLLRDHUP)

    def wait(self, timeout: float) -> None:
        """Sleep for at most `timeout` s, or until there is something, or a descriptor hangs up."""
        select.select([self._waking], (), (), max(0.0, timeout))

    def rest(self, timeout: float) -> None:
        """Sleep for `timeout` s whatever is sent, but no longer once a descriptor has hung up."""
        select.select([self._hung_up], (), (), max(0.0, timeout))

    def ready(self) -> Set[int]:
        """Return the watched descriptors that are readable now."""
        return {descriptor for descriptor, _ in self._readable.poll(0)}

    def take(self) -> List[Any]:
        """Return what has been put so far, in order."""
        with suppress(BlockingIOError):  # whoever wakes us may be about to
            os.read(self._reader, 4096)
        self._woken = False
        return [self._items.popleft() for _ in range(len(self._items))]


class Arrived(NamedTuple):
    """A message has come, at ROS time `ros_time` in ns; `whole`: its data is all of it."""

    time: float
    connection: Connection
    data: bytes
    whole: bool
    ros_time: int
    waited: float = 0.0  # for us, s at most


Happening = Union[Connected, Interrupted, Disconnected, Arrived, Tick]
"""A Tick: all that had come by then was told before, so far may time pass."""
Happen = Callable[[], Iterable[Happening]]


class Subscriptions:
    """The connections of every subscribed topic.

    All methods but `subscribe` are for one thread, which sleeps in `inbox`. Times are those of
    `now`, the robot's clock. `refused(topic, claim, why)` is called for who is not whom it calls
    itself. On a topic that `wakes`, what comes wakes the reader.
    """

    def __init__(
        self,
        now: Callable[[], float],
        refused: Callable[[str, str, str], object],
        wakes: Callable[[str], bool] = lambda topic: True,
    ) -> None:
        self.inbox = Inbox()
        self._times = ArrivalTimes(now)
        self._time = self._times.looked.time  # of what happens now
        self._wakes = wakes
        self._told: Deque[Tuple[str, Happen]] = deque()  # by whom else, on a topic
        self._caller_ids = CallerIds(self._identified, refused)
        self._reconnection = Reconnection(
            lambda topic, settle: self._tell(topic, lambda: self._gone(settle()))
        )
        self.topics: Dict[str, HandedOver] = {}  # those that are subscribed
        self._standing: Dict[int, Connection] = {}
        self._large: Set[int] = set()  # descriptors that are ready late: less may come

    def subscribe(self, topic: str) -> None:
        """Subscribe `topic`; waits for the master."""
        made = lambda transport: self._tell(topic, partial(self._take_over, topic, transport))
        closed = lambda transport: self._tell(topic, partial(self._closed, topic, transport))
        implementation = self.topics[topic] = HandedOver(topic, made, closed)
        implementation.subscribe()

    def unsubscribe(self, topic: str) -> Callable[[], None]:
        """Read `topic` no more; return what ends its subscription, and waits for the master."""
        implementation = self.topics.pop(topic)
        for connection in list(self._standing.values()):
            if connection.topic == topic:
                self._forget(connection)
                connection.transport.close()  # or what comes on it would wake the reader
        self._reconnection.forget(topic)
        return lambda: implementation.subscriber.unregister()

    def choose_waking(self) -> None:
        """Ask again of each topic whether it wakes."""
        for connection in self._standing.values():
            self._have_wake(connection, connection.is_large or self._wakes(connection.topic))

    def publishers(self, topic: str) -> Set[str]:
        """Return who publishes a topic, by the connections that stand."""
        standing = self._standing.values()
        return {each.publisher for each in standing if each.topic == topic and each.is_known}

    def read(self, since: float = float("-inf")) -> List[Happening]:
        """Return what has happened and come, in order; none before `since`. Take `inbox` before."""
        looked = self._times.look()
        self._time = looked.time
        found: List[Happening] = []
        for _ in range(len(self._told)):
            topic, happen = self._told.popleft()
            if topic in self.topics:  # else it was unsubscribed
                found += happen()
        self._caller_ids.ask_again()
        since = looked.time if found else since
        ready, self._large = self.inbox.ready() | self._large, set()
        came = [*self._read(ready, since), *self._gone(self._reconnection.overdue())]
        return [*found, *sorted([*came, Tick(looked.time)], key=lambda each: each.time)]

    def _tell(self, topic: str, happen: Happen) -> None:
        """Have something happen on a topic at the next look; from any thread."""
        self._told.append((topic, happen))
        self.inbox.wake()

    def _identified(self, connection: Connection, node: Optional[str], at: str) -> None:
        def happen() -> Iterator[Happening]:
            if self._caller_ids.answered(connection, node, at):
                yield from self._recognize(connection)

        self._tell(connection.topic, happen)

    def _closed(self, topic: str, transport: Any) -> Iterator[Happening]:
        for connection in list(self._standing.values()):
            if connection.transport is transport:
                yield from self._lose(connection)
        uri = transport.endpoint_id
        if not transport.header or self._reconnection.is_doubted(topic, uri):
            yield from self._gone(self._reconnection.lost(topic, uri, self.topics[topic]))

    def _take_over(self, topic: str, transport: Any) -> Iterator[Happening]:
        if transport.done or transport.socket is None:
            return
        try:
            connection = Connection(topic, transport)
        except OSError:
            return  # rospy has closed it in a thread of its own, which we are told next
        if connection.descriptor in self._standing:
            yield from self._lose(self._standing[connection.descriptor])
        self._standing[connection.descriptor] = connection
        with suppress(OSError):  # it has just been closed, which we are told next
            self.inbox.watch(connection.descriptor)
            self._have_wake(connection, self._wakes(topic))
        self._caller_ids.claim(connection)

    def _recognize(self, connection: Connection) -> Iterator[Happening]:
        topic, publisher = connection.topic, connection.publisher
        yield from self._disown(connection)
        alike = [each for each in self._standing.values() if each.is_known and each.topic == topic]
        if [each.publisher for each in alike].count(publisher) == 1:
            yield Connected(self._time, topic, publisher, connection.at)
        self._reconnection.connected(topic, publisher, connection.uri)
        data, connection.newest = connection.newest, None
        if data is not None:
            yield Arrived(self._time, connection, data, True, self._times.looked.ros_time)

    def _disown(self, by: Connection) -> Iterator[Happening]:
        """Ask again about connections to where a node is no more: another has its name."""
        alike = [each for each in self._standing.values() if each.publisher == by.publisher]
        former = [each for each in alike if each.is_known and each.uri != by.uri]
        for each in former:
            self._caller_ids.claim(each)
        for topic in {each.topic for each in former} - {by.topic}:
            if by.publisher not in self.publishers(topic):
                yield Disconnected(self._time, topic, by.publisher)

    def _read(self, ready: Set[int], since: float) -> Iterator[Happening]:
        for descriptor in ready:
            connection = self._standing.get(descriptor)
            if connection is None:
                continue
            stands, read = connection.read(), clock.now()
            self._time, _ = self._times.at(read)
            times, before = self._times, connection.emptied or self._times.before
            connection.emptied = before if connection.frames.more else None
            for data, whole, noted, former in connection.frames.take():
                if connection.is_known:
                    time, ros_time = times.of(noted, read, before)
                    alone = former <= before.wall  # of what came since all was read
                    first = before.time if alone else times.of(former, read, before)[0]
                    time, first = max(since, time), min(first, time)
                    yield Arrived(time, connection, data, whole, ros_time, time - first)
                else:
                    connection.newest = data
            if not stands:
                connection.transport.close()
                yield from self._lose(connection)
                continue
            if connection.expects > 1:
                self._large.add(descriptor)
            if not connection.wakes and len(connection.frames):
                connection.is_large = True  # who sends it would wait for us
                self._have_wake(connection, True)

    def _have_wake(self, connection: Connection, wakes: bool) -> None:
        if connection.wakes is not wakes:
            with suppress(OSError):  # it has just been closed, which we are told next
                self.inbox.watch_otherwise(connection.descriptor, wakes)
                connection.wakes = wakes

    def _lose(self, connection: Connection) -> Iterator[Happening]:
        self._forget(connection)
        topic, publisher = connection.topic, connection.publisher
        lost = topic, connection.uri, self.topics[topic]
        if not connection.is_known:
            yield from self._gone(self._reconnection.lost(*lost))
        elif publisher not in self.publishers(topic):
            gone = self._reconnection.lost(*lost, publisher, connection.at)
            yield from self._gone(gone) if gone else [Interrupted(self._time, topic, publisher)]

    def _forget(self, connection: Connection) -> None:
        del self._standing[connection.descriptor]
        self._caller_ids.drop(connection)

    def _gone(self, doubts: Iterable[Doubt]) -> Iterator[Happening]:
        for doubt in doubts:
            if doubt.publisher and doubt.publisher not in self.publishers(doubt.topic):
                self._caller_ids.forget(doubt.publisher, doubt.uri)
                told = self._time, doubt.topic, doubt.publisher
                yield Disconnected(*told, doubt.gone, doubt.left)

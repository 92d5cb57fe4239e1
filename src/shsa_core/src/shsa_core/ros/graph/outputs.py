"""The topics that a substitute has advertised: one publisher a topic."""
import threading
from typing import Callable, Dict, FrozenSet, Iterable, List, Sequence, Tuple

import genpy
import rospy

from shsa_core.model.service import Signal
from shsa_core.ros.graph.fields import Field, unknown_message
from shsa_core.ros.graph.messages import message_class


class _Joining(rospy.SubscribeListener):
    def __init__(self, joined: Callable[[str], None]) -> None:
        super().__init__()
        self._joined = joined

    def peer_subscribe(self, topic: str, *_: object) -> None:
        self._joined(topic)


class Outputs:
    """Publishers of topics.

    `advertised(topic)` is called when messages can be published on a topic, `joined(topic,
    consumer)` when a consumer has connected to one, never before that; from any thread.
    """

    def __init__(
        self, advertised: Callable[[str], None], joined: Callable[[str, str], None]
    ) -> None:
        self._advertised = advertised
        self._joined = joined
        self._publishers: Dict[str, rospy.Publisher] = {}
        self._seen: Dict[str, List[object]] = {}
        self._fields: Dict[Tuple[str, str], Field] = {}
        self._lock = threading.Lock()

    def advertise(self, topic: str, kind: str) -> None:
        """Register as a publisher; waits for the master."""
        publisher = rospy.Publisher(
            topic,
            message_class(kind),
            _Joining(self._report),
            queue_size=10,
            tcp_nodelay=True,
        )
        with self._lock:
            self._publishers[topic] = publisher
            self._advertised(topic)
        self._report(topic)

    def withdraw(self, topics: Iterable[str]) -> None:
        """Publish on these topics no more; waits for the master."""
        for topic in topics:
            with self._lock:
                publisher = self._publishers.pop(topic)
                self._seen.pop(topic, None)
            publisher.unregister()

    def _report(self, topic: str) -> None:
        """Say who has joined since the last look."""
        with self._lock:
            publisher = self._publishers.get(topic)
            connections = (
                [] if publisher is None or publisher.impl is None else publisher.impl.connections
            )
            seen = self._seen.get(topic, [])
            self._seen[topic] = list(connections)
            for connection in connections:
                if connection not in seen:
                    self._joined(topic, connection.endpoint_id)

    def connected(self, topic: str) -> FrozenSet[str]:
        """The consumers that are connected to a topic."""
        publisher = self._publishers.get(topic)
        if publisher is None or publisher.impl is None:
            return frozenset()
        return frozenset(connection.endpoint_id for connection in publisher.impl.connections)

    def publish(
        self,
        outputs: Sequence[Signal],
        values: Sequence[float],
        served: FrozenSet[str],
        only: str,
    ) -> None:
        """Publish `values` in the fields `outputs` of one message.

        To `only` or, if empty, to all but those `served`.
        """
        publisher = self._publishers.get(outputs[0].topic)
        if publisher is None:
            return  # withdrawn already
        message = unknown_message(publisher.data_class)
        for signal, value in zip(outputs, values):
            self._field(signal).set(message, value)
        if message._has_header:
            message.header.stamp = rospy.Time.now()
        if only or served:
            _publish_to(publisher, message, served, only)
        else:
            publisher.publish(message)

    def _field(self, signal: Signal) -> Field:
        key = signal.type, signal.field
        if key not in self._fields:
            self._fields[key] = Field(message_class(signal.type), signal.field)
        return self._fields[key]


def _publish_to(
    publisher: rospy.Publisher, message: genpy.Message, served: FrozenSet[str], only: str
) -> None:
    impl = publisher.impl
    impl.acquire()
    try:
        for connection in list(impl.connections):
            consumer = connection.endpoint_id
            if consumer == only if only else consumer not in served:
                impl.publish(message, connection_override=connection)
    finally:
        impl.release()

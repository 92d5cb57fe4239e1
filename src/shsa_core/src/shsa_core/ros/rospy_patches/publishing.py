"""Messages whose bytes are made already, and messages to some of the subscribers alone.

Faults of rospy 1.15 to 1.17: `Publisher.publish` serializes a message for every call, and numbers
its header; to one connection alone a message goes without the lock that keeps others apart. And
`Publisher.__init__` registers first: whoever connects before it goes on is told to no listener, and
has no queue, so that one that hangs holds the publisher up for good.
"""
from typing import Any, Callable, Iterable, List, Mapping, Optional, Type

import genpy
import rospy
from rospy.impl.registration import Registration, get_topic_manager
from rospy.impl.tcpros import get_tcpros_handler
from rospy.topics import _PublisherImpl


def advertise(
    topic: str,
    kind: Type[genpy.Message],
    queue_size: int,
    listener: Optional[rospy.SubscribeListener] = None,
    headers: Optional[Mapping[str, str]] = None,
    latch: bool = False,
) -> rospy.Publisher:
    """Register as a publisher that is complete by then; waits for the master."""
    name, manager = rospy.resolve_name(topic), get_topic_manager()
    with manager.lock:
        known = manager.get_impl(Registration.PUB, name)
        impl = known or _PublisherImpl(name, kind)
        impl.set_queue_size(queue_size)
        impl.add_headers(headers or {})
        if latch:
            impl.enable_latch()
        if listener is not None:
            impl.add_subscriber_listener(listener)
        get_tcpros_handler().set_tcp_nodelay(name, True)
        if known is None:
            manager._add(impl, manager.pubs, Registration.PUB)
        return rospy.Publisher(topic, kind, queue_size=queue_size)


def as_written(kind: Type[genpy.Message]) -> Callable[[bytes], genpy.Message]:
    """Return what makes messages of type `kind` that rospy sends as they were serialized."""

    class Written(kind):  # type: ignore[misc,valid-type]
        """A message that is sent as it was written."""

        __slots__ = ("written",)
        _has_header = False

        def __init__(self, data: bytes) -> None:
            self.written = data

        def serialize(self, buff: Any) -> None:
            """Write the message."""
            buff.write(self.written)

    return Written


def connections_of(publisher: rospy.Publisher) -> List[Any]:
    """Return rospy's connections to the subscribers; none if it publishes no more."""
    return [] if publisher.impl is None else list(publisher.impl.connections)


def send(publisher: rospy.Publisher, message: genpy.Message, connections: Iterable[Any]) -> None:
    """Publish to these connections alone, if it publishes at all."""
    impl = publisher.impl
    if impl is None:
        return
    impl.acquire()
    try:
        for connection in connections:
            impl.publish(message, connection_override=connection)
    finally:
        impl.release()

"""Messages whose bytes are made already, and messages to some of the subscribers alone.

Faults of rospy 1.15 to 1.17: `Publisher.publish` serializes a message for every call, and numbers
its header; to one connection alone a message goes without the lock that keeps others apart.
"""
from typing import Any, Callable, Iterable, List, Type

import genpy
import rospy


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

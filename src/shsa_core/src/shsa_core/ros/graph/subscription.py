"""A subscription of rospy that tells of each connection that has ended."""
from typing import Any, Callable, Type

import rospy
from rospy.impl.registration import Registration, get_topic_manager
from rospy.topics import _SubscriberImpl

Ended = Callable[[str, Any], None]
"""A topic, and rospy's connection of it."""


class _Implementation(_SubscriberImpl):
    """rospy's side of a topic: `ended` is called once all that had come on a connection is read."""

    def __init__(self, topic: str, kind: Type[Any], ended: Ended) -> None:
        super().__init__(topic, kind)
        self._ended = ended

    def remove_connection(self, c: Any) -> None:
        """Called by rospy, by the thread that read the connection."""
        super().remove_connection(c)
        self._ended(self.resolved_name, c)


def subscribe(
    topic: str, kind: Type[Any], heard: Callable[[Any, str], None], ended: Ended
) -> rospy.Subscriber:
    """Subscribe a topic, each message at once; waits for the master.

    `heard(message, topic)`. What this process subscribes already keeps its `ended`.
    """
    manager = get_topic_manager()
    with manager.lock:
        if rospy.names.resolve_name(topic) not in manager.subs:
            implement_with(_Implementation(topic, kind, ended))
        return rospy.Subscriber(topic, kind, heard, topic, queue_size=1, tcp_nodelay=True)


def implement_with(implementation: _SubscriberImpl) -> None:
    """Have rospy use this side of a topic that is not subscribed yet; with its manager's lock."""
    manager = get_topic_manager()
    manager._add(implementation, manager.subs, Registration.SUB)

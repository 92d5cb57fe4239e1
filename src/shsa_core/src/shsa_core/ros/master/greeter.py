"""Tells each new subscriber what it has missed."""
from typing import Any, Callable

import rospy

Tell = Callable[[Any], None]
"""Publishes a message to one subscriber alone."""


class Greeter(rospy.SubscribeListener):
    """Calls `greet` with what tells each new subscriber alone, in a thread of rospy."""

    def __init__(self, greet: Callable[[Tell], None]) -> None:
        super().__init__()
        self._greet = greet

    def peer_subscribe(self, topic_name: str, topic_publish: object, peer_publish: Tell) -> None:
        """Called by rospy once a subscriber has connected."""
        self._greet(peer_publish)

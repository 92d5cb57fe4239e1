"""What a substitute subscribes: the fields of messages, as numbers."""
from typing import Callable, Dict, Iterable, Tuple

import genpy
import rospy

from shsa_core.model.service import Signal
from shsa_core.ros.graph.fields import Field
from shsa_core.ros.graph.messages import message_class
from shsa_core.ros.graph.subscription import Ended, subscribe

Values = Tuple[Tuple[str, float], ...]
"""Fields by name, and their values."""


class Inputs:
    """Subscriptions, one a topic.

    `heard(topic, publisher, values, stamp)` is called, from rospy's threads, at every message, and
    `ended(topic, connection)` when one has ended.

    What was subscribed once stays so: a topic that is left and joined again at once can hang rospy.
    """

    def __init__(self, heard: Callable[[str, str, Values, int], None], ended: Ended) -> None:
        self._heard, self._ended = heard, ended
        self._subscribers: Dict[str, rospy.Subscriber] = {}
        self._fields: Dict[str, Dict[str, Field]] = {}

    def listen(self, signals: Iterable[Signal]) -> None:
        """Subscribe what is not subscribed yet; waits for the master."""
        for signal in signals:
            kind = message_class(signal.type)
            # A new dictionary: the receiving thread may be iterating over the old one.
            fields = {**self._fields.get(signal.topic, {}), signal.field: Field(kind, signal.field)}
            self._fields[signal.topic] = fields
            if signal.topic not in self._subscribers:
                self._subscribers[signal.topic] = subscribe(
                    signal.topic, kind, self._received, self._ended
                )

    def _received(self, message: genpy.Message, topic: str) -> None:
        fields = self._fields[topic].items()
        found = ((name, field.get(message)) for name, field in fields)
        values = tuple((name, value) for name, value in found if value is not None)
        stamp = message.header.stamp.to_nsec() if message._has_header else 0
        self._heard(topic, message._connection_header["callerid"], values, stamp)

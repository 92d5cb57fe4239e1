"""The values that a substitute computes from: subscribed fields, and how old each is."""
from typing import Callable, Dict, Iterable, List, Optional

import genpy
import rospy

from shsa_core.model.som import Service
from shsa_core.ros.graph import clock
from shsa_core.ros.graph.fields import Field
from shsa_core.ros.graph.messages import message_class

STALE_PERIODS = 5.0
STALE_AT_LEAST = 0.1  # s; the scheduler's hiccups are not the sensor's


class Input:
    """The newest value of one field; `value` is None before the first message."""

    def __init__(self, service: Service) -> None:
        self.value: Optional[float] = None
        self.time = 0.0
        self._field = Field(message_class(service.type), service.field)
        self._stale_after = max(STALE_PERIODS * service.period, STALE_AT_LEAST)

    def take(self, message: genpy.Message, now: float) -> None:
        """Read the field of a message that came at `now`."""
        self.time = now
        self.value = self._field.get(message)

    def fresh(self, now: float) -> bool:
        """Whether the value is recent enough to count."""
        return self.value is not None and now - self.time <= self._stale_after


class Inputs:
    """Fields of topics, one subscription a topic; `arrived` is called, from rospy's threads, at every message.

    What was subscribed once stays so: a topic that is left and joined again at once can hang rospy.
    """

    def __init__(self, arrived: Callable[[], None]) -> None:
        self._arrived = arrived
        self._subscribers: Dict[str, rospy.Subscriber] = {}
        self._inputs: Dict[str, Dict[str, Input]] = {}

    def listen(self, services: Iterable[Service]) -> List[Input]:
        """The inputs of `services`, in order; what is not subscribed yet is subscribed now."""
        found = []
        for service in services:
            inputs = self._inputs.setdefault(service.topic, {})
            if service.path not in inputs:
                # A new dictionary: the receiving thread may be iterating over the old one.
                inputs = self._inputs[service.topic] = {**inputs, service.path: Input(service)}
            found.append(inputs[service.path])
            if service.topic not in self._subscribers:
                self._subscribers[service.topic] = rospy.Subscriber(
                    service.topic,
                    message_class(service.type),
                    self._received,
                    service.topic,
                    queue_size=1,
                    tcp_nodelay=True,
                )
        return found

    def _received(self, message: genpy.Message, topic: str) -> None:
        now = clock.now()
        for each in self._inputs.get(topic, {}).values():
            each.take(message, now)
        self._arrived()

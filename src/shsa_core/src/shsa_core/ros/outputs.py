"""The topics that a substitute has advertised: one publisher a topic."""
import threading
from contextlib import suppress
from typing import Any, Callable, Dict, FrozenSet, List

import genpy
import rospy

from shsa_core.errors import ShsaError
from shsa_core.message_types import message_class
from shsa_core.model.field_value import Field
from shsa_core.ros import settings
from shsa_core.ros.messages.fields import read_message
from shsa_core.ros.rospy_patches.publishing import advertise, connections_of, send
from shsa_core.substitution.composing import compose, normalize, quaternions
from shsa_core.substitution.events import Advertise, Compose, Publish


class Outputs(rospy.SubscribeListener):
    """Publishers of topics.

    `advertised(topic)` is called when messages can be published on a topic, `joined(topic,
    consumer)` when a consumer has connected to one, never before that; from any thread.
    """

    def __init__(
        self, advertised: Callable[[str], None], joined: Callable[[str, str], None]
    ) -> None:
        super().__init__()
        self._advertised, self._joined = advertised, joined
        self._publishers: Dict[str, rospy.Publisher] = {}
        self._seen: Dict[str, List[Any]] = {}
        self._composed: Dict[str, _Composed] = {}
        self._lock = threading.Lock()

    def advertise(self, command: Advertise) -> None:
        """Register as a publisher; waits for the master."""
        # Who joins is served by the core: once muted, rospy would send what is old.
        headers = {"latching": "1"} if command.latched else None
        topic, kind = command.topic, message_class(command.type)
        publisher = advertise(topic, kind, settings.CONSUMER_QUEUE, self, headers)
        with self._lock:
            self._publishers[topic] = publisher
            self._advertised(topic)
        self.peer_subscribe(topic)

    def withdraw(self, topic: str) -> None:
        """Publish on a topic no more; waits for the master."""
        with self._lock:
            publisher = self._publishers.pop(topic)
            self._seen.pop(topic, None)
        publisher.unregister()

    def peer_subscribe(self, topic: str, *_: object) -> None:
        """Say who has joined since the last look; called by rospy once a consumer has connected."""
        with self._lock:
            seen = self._seen.get(topic, [])
            self._seen[topic] = connections = self._connections(topic)
            for connection in connections:
                if connection not in seen:
                    self._joined(topic, connection.endpoint_id)

    def _connections(self, topic: str) -> List[Any]:
        publisher = self._publishers.get(topic)
        return [] if publisher is None else connections_of(publisher)

    def connected(self, topic: str) -> FrozenSet[str]:
        """Return the consumers that are connected to a topic, and this node, which need not be."""
        return frozenset((rospy.get_name(), *(c.endpoint_id for c in self._connections(topic))))

    def compose(self, command: Compose) -> None:
        """Have the messages of a topic start from its last good one, as far as it can be read."""
        self._composed[command.topic] = _Composed(command)

    def publish(self, command: Publish) -> None:
        """Publish values in the fields of one message of a topic that was composed."""
        topic = command.outputs[0].topic
        publisher = self._publishers.get(topic)
        if publisher is None:
            return  # withdrawn already
        message = self._composed[topic].message(command)
        only, served = command.only, command.served
        if not only and not served:
            publisher.publish(message)
            return
        goes_to = lambda consumer: consumer == only if only else consumer not in served
        connections = connections_of(publisher)
        send(publisher, message, [each for each in connections if goes_to(each.endpoint_id)])


class _Composed:
    """The message of a topic, written anew each time: whoever publishes it serializes it first."""

    def __init__(self, command: Compose) -> None:
        kind = message_class(command.type)
        last = None
        with suppress(ShsaError):  # it may be of another version of the type
            last = read_message(kind, command.last_message) if command.last_message else None
        self._message = compose(kind, last, command.others, dict(command.written))
        self._fields = {name: Field(kind, name) for name, _ in command.written}
        self._quaternions = tuple(quaternions(self._message))

    def message(self, command: Publish) -> genpy.Message:
        """Return the message with the values and the stamp of a command."""
        message = self._message
        for signal, value in zip(command.outputs, command.values):
            self._fields[signal.field].set(message, value)
        for quaternion in self._quaternions:
            normalize(quaternion)
        if message._has_header:
            stamp = command.stamp
            message.header.stamp = rospy.Time(0, stamp) if stamp else rospy.Time.now()
        return message

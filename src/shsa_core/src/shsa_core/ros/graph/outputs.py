"""The topics that a substitute publishes on, or may have to: one publisher a topic."""
import threading
from typing import Callable, Dict, Iterable, List

import rospy

from shsa_core.model.som import Service
from shsa_core.ros.graph.announce import announce, assure
from shsa_core.ros.graph.messages import message_class

CALM = 0.2  # s from a takeover on in which nothing else is done
UNHURRIED = (0.5, 1.0, 2.0)  # s; by then the master has told everybody, if it can


class _Joining(rospy.SubscribeListener):
    def __init__(self, joined: Callable[[], None]) -> None:
        super().__init__()
        self._joined = joined

    def peer_subscribe(self, *_: object) -> None:
        self._joined()


class Outputs:
    """Publishers of topics; `joined` is called, from rospy's threads, when a consumer has connected to one."""

    def __init__(self, joined: Callable[[], None]) -> None:
        self._joined = joined
        self._publishers: Dict[str, rospy.Publisher] = {}

    def prepare(self, services: Iterable[Service]) -> None:
        """Advertise the topics of `services`, and no others; there is no hurry: the master tells the consumers first."""
        wanted = {service.topic: service for service in services}
        missing = wanted.keys() - self._publishers.keys()
        new = [self._advertise(wanted[topic]) for topic in missing]
        if new:
            threading.Thread(target=assure, args=(new, UNHURRIED), daemon=True).start()
        _withdraw([self._publishers.pop(t) for t in self._publishers.keys() - wanted.keys()])

    def take(self, service: Service) -> rospy.Publisher:
        """The publisher of the topic of `service`, the only one from now on; a new one is announced at once."""
        publisher = self._publishers.get(service.topic)
        if publisher is None:
            publisher = self._advertise(service)
            threading.Thread(target=announce, args=(publisher,), daemon=True).start()
        else:
            threading.Thread(target=assure, args=([publisher],), daemon=True).start()
        others = [self._publishers.pop(t) for t in self._publishers.keys() - {service.topic}]
        if others:
            threading.Thread(target=_withdraw_later, args=(others,), daemon=True).start()
        return publisher

    def _advertise(self, service: Service) -> rospy.Publisher:
        publisher = rospy.Publisher(
            service.topic,
            message_class(service.type),
            _Joining(self._joined),
            queue_size=10,
            tcp_nodelay=True,
        )
        self._publishers[service.topic] = publisher
        return publisher


def _withdraw_later(publishers: List[rospy.Publisher]) -> None:
    """Take topics back once the first messages are out: each takes a call to the master."""
    rospy.rostime.wallsleep(CALM)
    if not rospy.is_shutdown():
        _withdraw(publishers)


def _withdraw(publishers: List[rospy.Publisher]) -> None:
    for publisher in publishers:
        publisher.unregister()

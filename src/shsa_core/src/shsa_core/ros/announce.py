"""Tells subscribers of a new publisher at once: the master's own notice takes up to 0.1 s."""
import threading
import xmlrpc.client
from typing import Iterable, List, Set

import rosgraph
import rospy

from shsa_core.ros.slave import slave

PAUSES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)  # s before each look whether all have connected


def announce(publisher: rospy.Publisher) -> None:
    """Tell every subscriber of a new publisher of it, and those again who have not connected after a while.

    A rospy subscriber that is told twice, by us and by the master, may connect twice at the same time. Then each end
    drops a connection, now and then not the same one, and none is left: nobody but us would ever tell it again.
    What fails here the master makes good. Takes some seconds: call it in a thread of its own.
    """
    topic, kind = publisher.resolved_name, publisher.type
    master = rosgraph.Master(rospy.get_name())
    uri = rospy.get_node_uri()
    try:
        subscribers: List[str] = master.registerPublisher(topic, kind, uri)
        # Registering as a subscriber is the cheapest way to the list of publishers.
        publishers: List[str] = master.registerSubscriber(topic, kind, uri)
        _tell(subscribers, topic, publishers)
        master.unregisterSubscriber(topic, uri)
        for pause in PAUSES:
            rospy.rostime.wallsleep(pause)
            if rospy.is_shutdown() or publisher.impl is None:
                return
            _tell_again(master, publisher)
    except (rosgraph.MasterException, OSError) as error:
        rospy.logwarn("%s could not be announced: %s", topic, error)


def _tell_again(master: rosgraph.Master, publisher: rospy.Publisher) -> None:
    """Tell those subscribers that have no connection."""
    topic = publisher.resolved_name
    publishing, subscribing, _ = master.getSystemState()
    connected = _connected(publisher)
    missing = [node for node in _of_topic(subscribing, topic) if node not in connected]
    if missing:
        publishers = [master.lookupNode(node) for node in _of_topic(publishing, topic)]
        _tell([master.lookupNode(node) for node in missing], topic, publishers)


def _connected(publisher: rospy.Publisher) -> Set[str]:
    impl = publisher.impl
    return {connection.endpoint_id for connection in impl.connections} if impl else set()


def _of_topic(state: Iterable[List], topic: str) -> List[str]:
    return [node for name, nodes in state if name == topic for node in nodes]


def _tell(subscribers: Iterable[str], topic: str, publishers: List[str]) -> None:
    """Tell the full list of publishers. Each call has a thread and a timeout: a hung subscriber delays nobody."""

    def call(subscriber: str) -> None:
        try:
            slave(subscriber).publisherUpdate("/master", topic, publishers)
        except (OSError, xmlrpc.client.Error) as error:
            rospy.logdebug("%s was not told of %s: %s", subscriber, topic, error)

    for subscriber in subscribers:
        threading.Thread(target=call, args=(subscriber,), daemon=True).start()

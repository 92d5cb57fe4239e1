"""Tells subscribers of a new publisher at once: the master's own notice takes up to 0.1 s."""
import threading
import xmlrpc.client
from typing import Iterable, List, Sequence, Set, Tuple

import rosgraph
import rospy

from shsa_core.ros.graph.node_api import node_api

Graph = Sequence[Tuple[str, List[str]]]
"""Topics, and the nodes that publish or subscribe each."""
PAUSES = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)  # s before each look whether all have connected


def announce(publisher: rospy.Publisher) -> None:
    """Tell every subscriber of a new publisher of it at once; then see to it as `assure` does."""
    topic, kind = publisher.resolved_name, publisher.type
    master = rosgraph.Master(rospy.get_name())
    uri = rospy.get_node_uri()
    try:
        subscribers: List[str] = master.registerPublisher(topic, kind, uri)
        # Registering as a subscriber is the cheapest way to the list of publishers.
        publishers: List[str] = master.registerSubscriber(topic, kind, uri)
        master.unregisterSubscriber(topic, uri)
        _tell(subscribers, topic, publishers)
    except (rosgraph.MasterException, OSError) as error:
        rospy.logwarn("%s could not be announced: %s", topic, error)
    assure([publisher])


def assure(publishers: Sequence[rospy.Publisher], pauses: Iterable[float] = PAUSES) -> None:
    """Look after each pause whether every subscriber has connected, and tell those who have not.

    A rospy subscriber that is told twice, by us and by the master, may connect twice at the same time. Then each end
    drops a connection, now and then not the same one, and none is left: nobody but us would ever tell it again. And the
    master tells nobody of anything while three subscribers hang.
    Takes as long as the pauses: call it in a thread of its own.
    """
    master = rosgraph.Master(rospy.get_name())
    for pause in pauses:
        rospy.rostime.wallsleep(pause)
        current = [publisher for publisher in publishers if publisher.impl is not None]
        if rospy.is_shutdown() or not current:
            return
        try:
            publishing, subscribing, _ = master.getSystemState()
            for publisher in current:
                _tell_missing(master, publisher, publishing, subscribing)
        except (rosgraph.MasterException, OSError) as error:
            topics = ", ".join(publisher.resolved_name for publisher in current)
            rospy.logwarn("Who hears %s could not be looked up: %s", topics, error)


def _tell_missing(
    master: rosgraph.Master, publisher: rospy.Publisher, publishing: Graph, subscribing: Graph
) -> None:
    """Tell those subscribers that have no connection."""
    topic = publisher.resolved_name
    connected = _connected(publisher)
    missing = [node for node in of_topic(subscribing, topic) if node not in connected]
    if missing:
        publishers = [master.lookupNode(node) for node in of_topic(publishing, topic)]
        _tell([master.lookupNode(node) for node in missing], topic, publishers)


def _connected(publisher: rospy.Publisher) -> Set[str]:
    impl = publisher.impl
    return {connection.endpoint_id for connection in impl.connections} if impl else set()


def of_topic(state: Graph, topic: str) -> List[str]:
    """The nodes that publish or subscribe a topic, by one part of the master's getSystemState."""
    return [node for name, nodes in state if name == topic for node in nodes]


def _tell(subscribers: Iterable[str], topic: str, publishers: List[str]) -> None:
    """Tell the full list of publishers. Each call has a thread and a timeout: a hung subscriber delays nobody."""

    def call(subscriber: str) -> None:
        try:
            node_api(subscriber).publisherUpdate("/master", topic, publishers)
        except (OSError, xmlrpc.client.Error) as error:
            rospy.logdebug("%s was not told of %s: %s", subscriber, topic, error)

    for subscriber in subscribers:
        threading.Thread(target=call, args=(subscriber,), daemon=True).start()

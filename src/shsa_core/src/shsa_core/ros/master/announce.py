"""Tells subscribers of a new publisher at once: the master's own notice takes up to 0.1 s."""
import threading
from typing import Callable, FrozenSet, Iterable, List, Sequence, Tuple

import rospy

from shsa_core.ros.master.node_api import FAILURES, address, master_api, node_api

Graph = Sequence[Tuple[str, List[str]]]
"""Topics, and the nodes that publish or subscribe each."""


def announce(topic: str, kind: str) -> None:
    """Tell every subscriber of a topic that this node publishes it.

    Raises one of node_api.FAILURES.
    """
    master = master_api()
    uri = rospy.get_node_uri()
    subscribers: List[str] = master.registerPublisher(topic, kind, uri)
    # Registering as a subscriber is the cheapest way to the list of publishers.
    publishers: List[str] = master.registerSubscriber(topic, kind, uri)
    if not _listens(topic):
        master.unregisterSubscriber(topic, uri)
        if _listens(topic):  # it began meanwhile, and was not told of publishers since
            publishers = master.registerSubscriber(topic, kind, uri)
            subscribers = [*subscribers, uri]
    _tell(subscribers, topic, publishers)


def _listens(topic: str) -> bool:
    """Return whether this process subscribes a topic, as a substitute may its own."""
    return topic in dict(rospy.topics.get_topic_manager().get_subscriptions())


def remind(topics: Iterable[str], connected: Callable[[str], FrozenSet[str]]) -> None:
    """Tell the subscribers of `topics` that have not connected to us the publishers of each.

    A master that was started anew just after we were may not know us: then we register again.
    Raises one of node_api.FAILURES.
    """
    master = master_api()
    publishing, subscribing, _ = master.getSystemState()
    known = {topic for topic, nodes in publishing if rospy.get_name() in nodes}
    offered = {topic for topic, _ in rospy.topics.get_topic_manager().get_publications()}
    if offered.intersection(topics) - known:
        _register_again()
    for topic in topics:
        there = connected(topic)
        nodes = [node for node in of_topic(subscribing, topic) if node not in there]
        if nodes:
            publishers = [master.lookupNode(node) for node in of_topic(publishing, topic)]
            _tell([master.lookupNode(node) for node in nodes], topic, publishers)


def _register_again() -> None:
    """Register all that this process publishes and subscribes."""
    manager, master, uri = rospy.topics.get_topic_manager(), master_api(), rospy.get_node_uri()
    for topic, kind in manager.get_publications():
        master.registerPublisher(topic, kind, uri)
    for topic, kind in manager.get_subscriptions():
        master.registerSubscriber(topic, kind, uri)


def of_topic(state: Graph, topic: str) -> List[str]:
    """Return the nodes that publish or subscribe a topic, by one part of getSystemState."""
    return [node for name, nodes in state if name == topic for node in nodes]


def _tell(subscribers: Iterable[str], topic: str, publishers: List[str]) -> None:
    """Tell the full list of publishers.

    Each call has a thread and a timeout: a hung subscriber delays nobody.
    """

    def call(subscriber: str) -> None:
        try:
            address(subscriber)
            node_api(subscriber).publisherUpdate("/master", topic, publishers)
        except FAILURES as error:
            rospy.logdebug("%s was not told of %s: %s", subscriber, topic, error)

    for subscriber in subscribers:
        threading.Thread(target=call, args=(subscriber,), daemon=True).start()

"""Tells subscribers of a new publisher at once: the master's own notice takes up to 0.1 s."""
import threading
import xmlrpc.client
from typing import List

import rosgraph
import rospy

from shsa_core.ros.slave import slave


def announce(topic: str, message_type: str) -> None:
    """Tell every subscriber of `topic` the full list of its publishers, this node's publisher among them.

    Each call has a thread of its own and a timeout: a hung subscriber delays nobody. What fails here the master
    makes good.
    """
    uri = rospy.get_node_uri()
    master = rosgraph.Master(rospy.get_name())
    try:
        subscribers: List[str] = master.registerPublisher(topic, message_type, uri)
        # Registering as a subscriber is the cheapest way to the list of publishers.
        publishers: List[str] = master.registerSubscriber(topic, message_type, uri)
        for subscriber in subscribers:
            threading.Thread(
                target=_tell, args=(subscriber, topic, publishers), daemon=True
            ).start()
        master.unregisterSubscriber(topic, uri)
    except (rosgraph.MasterException, OSError) as error:
        rospy.logwarn("%s could not be announced: %s", topic, error)


def _tell(subscriber: str, topic: str, publishers: List[str]) -> None:
    try:
        slave(subscriber).publisherUpdate("/master", topic, publishers)
    except (OSError, xmlrpc.client.Error) as error:
        rospy.logdebug("%s was not told of %s: %s", subscriber, topic, error)

"""Finds the service behind a path such as `/odom/twist/twist/linear/x`."""
from typing import Dict, List, Sequence, Tuple

import rosgraph
import rospy

from shsa_core.errors import ShsaError
from shsa_core.model.som import Service, Som, merge_parameters
from shsa_core.ros.graph import clock
from shsa_core.ros.graph.messages import message_class
from shsa_core.ros.graph.som_parameter import get_som_parameter

OLD = 3.0  # s; a SOM that was read longer ago is read again before use
UNKNOWN_PERIOD = 0.1  # s; of a topic that the SOM does not have


class Directory:
    """The services of the SOM as of the last `refresh`; asks the master for what the SOM does not have."""

    def __init__(self) -> None:
        self._known: Dict[str, Service] = {}
        self._refreshed = float("-inf")

    def refresh(self, age: float = 0.0) -> None:
        """Read the SOM again if that was longer ago than `age` s, and load its message types.

        Both take milliseconds that are better spent before they are missed.
        """
        if clock.now() - self._refreshed <= age:
            return
        value = get_som_parameter()
        # What is not valid is named by those who watch the SOM; here the valid part will do.
        som, _ = merge_parameters(Som(), {} if value is None else value)
        for service in som:
            message_class(service.type)
        self._known = {service.path: service for service in som}
        self._refreshed = clock.now()

    def find(self, paths: Sequence[str]) -> List[Service]:
        """The services at `paths`; raises ShsaError if neither the SOM nor the master has one of them."""
        self.refresh(OLD)
        known = self._known
        if all(path in known for path in paths):
            return [known[path] for path in paths]
        types: List[Tuple[str, str]] = rosgraph.Master(rospy.get_name()).getTopicTypes()
        return [known[path] if path in known else _unmapped(path, dict(types)) for path in paths]


def _unmapped(path: str, types: Dict[str, str]) -> Service:
    topics = [topic for topic in types if path.startswith(topic + "/")]
    if not topics:
        raise ShsaError(f"{path}: neither in the SOM nor on a topic that the master knows")
    topic = max(topics, key=len)
    return Service("", topic, path[len(topic) + 1 :], types[topic], "", period=UNKNOWN_PERIOD)

"""Looks at the node that a substitute stands in for."""
from typing import Any, FrozenSet

import rospy

from shsa_core.ros.graph.node_api import FAILURES, master_api, node_api


def served_consumers(topic: str, original: str) -> FrozenSet[str]:
    """The consumers to which the node `original` has published on a topic already.

    Nobody if it does not answer.
    """
    try:
        api = node_api(master_api().lookupNode(original))
        stats: Any = api.getBusStats(rospy.get_name())
        info: Any = api.getBusInfo(rospy.get_name())
    except FAILURES:
        return frozenset()
    # A row of a publication ends with its connections: id, bytes sent, and what has been sent of
    # messages.
    rows = [row for entry in stats[2][0] if entry[0] == topic for row in entry[-1]]
    published_to = {row[0] for row in rows if row[2] > 0}
    outbound = [row for row in info[2] if row[2] == "o" and row[4] == topic]
    return frozenset(str(row[1]) for row in outbound if row[0] in published_to)

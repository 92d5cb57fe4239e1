"""Real time for a node whose launch says so, whatever /use_sim_time is.

Fault of rospy 1.15 to 1.17: the parameter counts for all nodes of a master, so that whoever sets it
can stop the time of healing.
"""
import os

import rospy.impl.simtime

WALL_TIME = "SHSA_WALL_TIME"
"""The environment variable by which a launch says `true`."""


def heed_launch() -> None:
    """Have /use_sim_time not count if the launch says so; before the node is initialised."""
    if os.environ.get(WALL_TIME) == "true":
        rospy.impl.simtime._is_use_simtime = lambda: False

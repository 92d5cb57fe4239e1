"""Tells whether a robot is maintained: a file that only our own account can write.

It outlives the reconfigurator and the boot, and needs no ROS master.
"""
import os

import rospy

from shsa_core.files.trust import written_by_others
from shsa_core.ros.succession import record_path


def maintained(namespace: str) -> bool:
    """Tell that the healing of this master and namespace is to kill and start nothing."""
    path = record_path(namespace, "maintenance")
    why = written_by_others(path) if os.path.lexists(path) else ""
    if why:
        rospy.logerr_once(f"Refused: {path} does not count, as {why}.")
    return os.path.lexists(path) and not why


def maintain(namespace: str, on: bool) -> None:
    """Have it be so, or not. Raises OSError."""
    path = record_path(namespace, "maintenance")
    if on:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, 0o600))
    elif os.path.lexists(path):
        os.unlink(path)

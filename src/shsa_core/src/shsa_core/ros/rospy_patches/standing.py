"""Keeps rospy's own threads alive, and its time real where the launch says so.

Faults of rospy 1.15 to 1.17: it accepts connections in one thread (`TCPServer.run`), and hears of
publishers in another (`RegManager.run`), each of which ends for good at the first error of the
operating system, as without a free descriptor; /use_sim_time counts for all nodes of a master, so
that whoever sets it can stop the time of healing.
"""
import os
import time
from functools import partialmethod
from typing import Any, Callable

import rospy
import rospy.impl.simtime
from rospy.impl.registration import RegManager
from rospy.impl.tcpros_base import TCPServer

from shsa_core.ros import settings

EXHAUSTED = (OSError, RuntimeError, MemoryError)
"""No descriptor; no thread; no memory."""
WALL_TIME = "SHSA_WALL_TIME"
"""The environment variable by which a launch says `true`."""


def heed_launch() -> None:
    """Have /use_sim_time not count if the launch says so; to be called before `init_node`."""
    if os.environ.get(WALL_TIME) == "true":
        rospy.impl.simtime._is_use_simtime = lambda: False


def keep_rospys_threads() -> None:
    """To be called before the node is initialised."""
    TCPServer.run = partialmethod(_kept, TCPServer.run, lambda server: server.is_shutdown)
    RegManager.run = partialmethod(_kept, RegManager.run, lambda _: rospy.is_shutdown())


def _kept(thread: Any, run: Callable[[Any], None], over: Callable[[Any], bool]) -> None:
    while True:
        try:
            run(thread)
            return
        except EXHAUSTED as error:
            if over(thread):
                return
            rospy.logerr_throttle(10.0, f"Connections wait, and are tried again: {error}")
            time.sleep(settings.TURN_S)

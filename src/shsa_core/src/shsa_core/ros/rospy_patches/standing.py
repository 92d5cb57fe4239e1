"""Keeps rospy's own threads until the end, and its time real where the launch says so.

Faults of rospy 1.15 to 1.17: it accepts connections in one thread (`TCPServer.run`), and hears of
publishers in another (`RegManager.run`), each of which ends for good at the first error of the
operating system, as without a free descriptor; it wakes the latter at the end before it says that
this is the end, and waits for it for 0.5 s. Whoever sets /use_sim_time stops the time of healing.
A timer, as of an action's status, ends for good when ROS time jumps back, as a looped bag has it
do, and with an error if its topic is closed at the end (`Timer.run`).
"""
import os
import time
from functools import partialmethod
from typing import Any, Callable

import rospy
from rospy.impl import registration, simtime
from rospy.impl.tcpros_base import TCPServer

from shsa_core.ros import settings

EXHAUSTED = (OSError, RuntimeError, MemoryError)
"""No descriptor; no thread; no memory."""
WALL_TIME = "SHSA_WALL_TIME"
"""The environment variable by which a launch says `true`."""


def heed_launch() -> None:
    """Have /use_sim_time not count if the launch says so; to be called before `init_node`."""
    if os.environ.get(WALL_TIME) == "true":
        simtime._is_use_simtime = lambda: False


def keep_rospys_threads() -> None:
    """To be called before the node is initialised."""
    TCPServer.run = partialmethod(_kept, TCPServer.run)
    registration.RegManager.run = partialmethod(_kept, registration.RegManager.run)
    registration.is_shutdown = rospy.core.is_shutdown_requested
    rospy.Timer.run = partialmethod(_timed, rospy.Timer.run)


def _timed(timer: Any, run: Callable[[Any], None]) -> None:
    timer._reset = True  # go on from the time that it is now
    try:
        run(timer)
    except rospy.ROSException:
        if not rospy.core.is_shutdown_requested():
            raise


def _kept(thread: Any, run: Callable[[Any], None]) -> None:
    while True:
        try:
            run(thread)
            return
        except EXHAUSTED as error:
            if rospy.is_shutdown():
                return
            rospy.logerr_throttle(10.0, f"Connections wait, and are tried again: {error}")
            time.sleep(settings.TURN_S)

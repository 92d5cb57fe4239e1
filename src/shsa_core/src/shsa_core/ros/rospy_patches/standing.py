"""Keeps rospy's own threads alive where processes, descriptors or memory have run out.

Fault of rospy 1.15 to 1.17: it accepts connections in one thread (`TCPServer.run`), and hears of
publishers in another (`RegManager.run`). Each ends for good at the first error of the operating
system: after a moment without a free descriptor nobody could ever
subscribe again, or hear of a new publisher.
"""
import time
from typing import Any, Callable

import rospy
from rospy.impl.registration import RegManager
from rospy.impl.tcpros_base import TCPServer

from shsa_core.ros import settings

EXHAUSTED = (OSError, RuntimeError, MemoryError)
"""No descriptor; no thread; no memory."""


def keep_rospys_threads() -> None:
    """To be called before the node is initialised."""
    TCPServer.run = _kept(TCPServer.run, lambda server: server.is_shutdown)
    RegManager.run = _kept(RegManager.run, lambda _: rospy.is_shutdown())


def _kept(run: Callable[[Any], None], over: Callable[[Any], bool]) -> Callable[[Any], None]:
    def kept(thread: Any) -> None:
        while True:
            try:
                run(thread)
                return
            except EXHAUSTED as error:
                if over(thread):
                    return
                rospy.logerr_throttle(10.0, f"Connections wait, and are tried again: {error}")
                time.sleep(settings.TURN_S)

    return kept

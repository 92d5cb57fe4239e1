"""Hears from the reconfigurator that it heeds the maintenance."""
import queue
import time
from typing import List

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from shsa_core.errors import ShsaError
from shsa_core.model.names import HEALERS, full_name
from shsa_core.ros.diagnostics import MAINTENANCE
from shsa_core.ros.master.node_api import FAILURES, BadAnswer, master_api, master_uri, resolved

PATIENCE_S = 5.0
"""The reconfigurator tells once a second."""


def check_master() -> None:
    """Raise ShsaError if ROS_MASTER_URI is none, or names a computer that is not known."""
    try:
        resolved(master_uri())
    except (OSError, BadAnswer) as error:
        raise ShsaError(f"ROS_MASTER_URI is {master_uri()}, which is not found: {error}") from error


def heeded(namespace: str, on: bool) -> bool:
    """Wait until the reconfigurator tells that maintenance is `on`, or not; return what it tells.

    Raises ShsaError if none is heard.
    """
    try:
        master_api("/shsa_maintenance").getPid()
    except FAILURES as error:
        raise ShsaError(f"no ROS master answers at {master_uri()}: {error}") from error
    rospy.init_node("shsa_maintenance", anonymous=True, disable_signals=True, disable_rostime=True)
    healer = full_name(HEALERS[1], namespace)
    inbox: "queue.Queue[DiagnosticArray]" = queue.Queue()
    subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, inbox.put)
    heard: List[bool] = []
    end = time.monotonic() + PATIENCE_S
    while on not in heard[-1:] and time.monotonic() < end:
        try:
            message = inbox.get(timeout=max(1e-3, end - time.monotonic()))
        except queue.Empty:
            break
        heard += told(message, healer)
    subscriber.unregister()
    if not heard:
        raise ShsaError(f"no reconfigurator {healer} is heard at {master_uri()}")
    return heard[-1]


def told(message: DiagnosticArray, healer: str) -> List[bool]:
    """Return what a message on /diagnostics says of maintenance, if the reconfigurator sent it."""
    if message._connection_header.get("callerid") != healer:
        return []
    name = f"{healer[1:]}: {MAINTENANCE}"
    return [row.level != DiagnosticStatus.OK for row in message.status if row.name == name]

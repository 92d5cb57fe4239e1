"""`motors`: the gateway from `/cmd_vel` to the base's serial line.

It only writes, and `drivetrain` alone reads: the wheels obey while nobody reads their speeds.
"""
import math
import threading
from typing import Optional, Tuple

import rospy
import serial
from geometry_msgs.msg import Twist

from shsa_core.ros.node import run
from shsa_rover.p2os import encode_motion
from shsa_rover.ros.gateway import BAUD_RATE, REPORT_PERIOD_S, WRITE_TIMEOUT_S, reason
from shsa_rover.ros.parameters import text_parameter

COMMAND_TIMEOUT_S = 2.0  # s without a command until it stops the base, whose watchdog waits as long


class Motors:
    """Writes each command at once, in m/s and rad/s, and a stop when no commands come."""

    def __init__(self) -> None:
        self._port = text_parameter("~port")
        self._line: Optional[serial.Serial] = None
        # rospy calls back from a thread of its own: the command is one tuple, so that it changes as
        # a whole.
        self._command = (0.0, 0.0)
        self._told = threading.Event()
        rospy.on_shutdown(self._told.set)
        rospy.Subscriber("cmd_vel", Twist, self._on_command, queue_size=1, tcp_nodelay=True)

    def run(self) -> None:
        """Runs until the node shuts down."""
        while not rospy.is_shutdown():
            told = self._told.wait(COMMAND_TIMEOUT_S)
            self._told.clear()
            self._send(self._command if told else (0.0, 0.0))

    def _on_command(self, message: Twist) -> None:
        velocity, turn_rate = message.linear.x, message.angular.z
        if math.isfinite(velocity) and math.isfinite(turn_rate):
            self._command = (velocity, turn_rate)
            self._told.set()
        else:
            rospy.logwarn_throttle(REPORT_PERIOD_S, "A command that is not a number is ignored.")

    def _send(self, command: Tuple[float, float]) -> None:
        try:
            if self._line is None:
                self._line = serial.Serial(self._port, BAUD_RATE, write_timeout=WRITE_TIMEOUT_S)
                rospy.loginfo("Commanding the base at %s.", self._port)
            # In one piece: another node writes to the same line.
            self._line.write(encode_motion(*command))
        except (serial.SerialException, OSError) as error:
            rospy.logwarn_throttle(
                REPORT_PERIOD_S,
                f"No command reaches the base at the serial port {self._port}: {reason(error)}.",
            )
            if self._line is not None:
                self._line.close()
                self._line = None


def main() -> None:
    """The node's entry point."""
    run("motors", lambda: Motors().run())

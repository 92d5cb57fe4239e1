"""`drivetrain`: the gateway from the base's serial line to velocities, accelerations and pose."""
import math
from typing import List

import rospy
import serial
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry as OdometryMessage

from shsa_core.ros.node import run
from shsa_rover import p2os
from shsa_rover.covariance import diagonal
from shsa_rover.odometry import Odometry
from shsa_rover.ros.gateway import REPORT_PERIOD_S, Gateway
from shsa_rover.ros.parameters import text_parameter
from shsa_rover.sensors import TRACK, SensorParameters


class Drivetrain:
    """Opens the base, and turns each of its reports into `/odom` and `/drivetrain/accel`."""

    def __init__(self) -> None:
        sensors = SensorParameters()
        self._variances = diagonal(6, {0: sensors.velocity_variance, 5: sensors.turn_rate_variance})
        self._errors = math.sqrt(sensors.velocity_variance), math.sqrt(sensors.turn_rate_variance)
        self._odometry = Odometry()
        self._odom = rospy.Publisher("odom", OdometryMessage, queue_size=10)
        self._accel = rospy.Publisher("drivetrain/accel", AccelStamped, queue_size=10)
        self._port = text_parameter("~port")

    def run(self) -> None:
        """Runs until the node shuts down."""
        Gateway("base", self._port, p2os.Packets(), self._take, self._wake).run()

    def _wake(self, line: serial.Serial) -> None:
        """Begin to open a base that says nothing; to one that is open already, SYNC0 is a pulse.

        Who opened it before may have ended before the last step, so that one follows as well: to a
        base that was not begun with, OPEN is SYNC1.
        """
        self._send(line, [p2os.Command(p2os.SYNC[0]), p2os.Command(p2os.OPEN)])

    def _take(self, line: serial.Serial, packets: List[bytes]) -> None:
        newest = packets[-1]
        if newest[0] in p2os.SYNC:
            self._send(line, self._next_step(newest[0]))
            return
        try:
            self._publish(p2os.decode_sip(newest))
        except p2os.PacketError as error:
            rospy.logwarn_throttle(REPORT_PERIOD_S, f"The base at {self._port} sent {error}.")

    def _next_step(self, answered: int) -> List[p2os.Command]:
        if answered != p2os.SYNC[-1]:
            return [p2os.Command(answered + 1)]
        rospy.loginfo("The base at %s is open.", self._port)
        return [p2os.Command(p2os.OPEN), p2os.Command(p2os.ENABLE, 1)]

    def _send(self, line: serial.Serial, commands: List[p2os.Command]) -> None:
        # In one piece: another node writes to the same line.
        line.write(b"".join(map(p2os.encode_command, commands)))

    def _publish(self, info: p2os.ServerInfo) -> None:
        """A report that waited is no news: this one has the time of its arrival."""
        stamp = rospy.Time.now()
        velocity = 0.5e-3 * (info.left + info.right)
        turn_rate = 1e-3 * (info.right - info.left) / TRACK
        state = self._odometry
        state.update(stamp.to_sec(), velocity, turn_rate, *self._errors)
        odom = OdometryMessage()
        odom.header.stamp = stamp
        odom.header.frame_id = "odom"
        odom.child_frame_id = "base_link"
        odom.pose.pose.position.x = state.x
        odom.pose.pose.position.y = state.y
        odom.pose.pose.orientation.z = math.sin(0.5 * state.heading)
        odom.pose.pose.orientation.w = math.cos(0.5 * state.heading)
        position = state.position_error**2
        flat = {0: position, 1: position, 5: state.heading_error**2}
        odom.pose.covariance = diagonal(6, flat)
        odom.twist.covariance = self._variances
        odom.twist.twist.linear.x = state.velocity
        odom.twist.twist.angular.z = state.turn_rate
        self._odom.publish(odom)
        accel = AccelStamped()
        accel.header.stamp = stamp
        accel.header.frame_id = "base_link"
        accel.accel.linear.x = state.acceleration
        accel.accel.angular.z = state.turn_acceleration
        self._accel.publish(accel)


def main() -> None:
    """The node's entry point."""
    run("drivetrain", lambda: Drivetrain().run())

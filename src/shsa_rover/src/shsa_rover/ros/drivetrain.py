"""`drivetrain`: velocities, accelerations and pose from the wheels."""
import math

import rospy
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry as OdometryMessage

from shsa_core.ros.node import publish, run
from shsa_rover.covariance import diagonal
from shsa_rover.odometry import Odometry


class Drivetrain:
    """Turns each reading of the wheels into `/odom` and `/drivetrain/accel`."""

    def __init__(self) -> None:
        self._odometry = Odometry()
        self._odom = rospy.Publisher("odom", OdometryMessage, queue_size=10)
        self._accel = rospy.Publisher("drivetrain/accel", AccelStamped, queue_size=10)
        rospy.Subscriber(
            "hardware/pose", OdometryMessage, self._on_reading, queue_size=1, tcp_nodelay=True
        )

    def _on_reading(self, reading: OdometryMessage) -> None:
        stamp = reading.header.stamp
        twist = reading.twist.twist
        state = self._odometry
        # A driver that says nothing of its errors has all of them 0.
        variances = reading.twist.covariance if any(reading.twist.covariance) else diagonal(6, {})
        errors = math.sqrt(max(0.0, variances[0])), math.sqrt(max(0.0, variances[-1]))
        state.update(stamp.to_sec(), twist.linear.x, twist.angular.z, *errors)
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
        odom.twist.covariance = variances
        odom.twist.twist.linear.x = state.velocity
        odom.twist.twist.angular.z = state.turn_rate
        publish(self._odom, odom)
        accel = AccelStamped()
        accel.header.stamp = stamp
        accel.header.frame_id = "base_link"
        accel.accel.linear.x = state.acceleration
        accel.accel.angular.z = state.turn_acceleration
        publish(self._accel, accel)


def serve() -> None:
    """Runs until the node shuts down."""
    Drivetrain()
    rospy.spin()


def main() -> None:
    """The node's entry point."""
    run("drivetrain", serve)

"""`imu`: gyroscope and accelerometer."""
from functools import partial

import rospy
from sensor_msgs.msg import Imu

from shsa_core.ros.node import publish, run


def serve() -> None:
    """Publishes the hardware's readings as they come."""
    publisher = rospy.Publisher("imu/data", Imu, queue_size=10)
    forward = partial(publish, publisher)
    rospy.Subscriber("hardware/imu", Imu, forward, queue_size=1, tcp_nodelay=True)
    rospy.spin()


def main() -> None:
    """The node's entry point."""
    run("imu", serve)

"""`imu`: the gateway from the IMU's serial line, gyroscope and accelerometer, to `/imu/data`."""
from typing import List

import rospy
import serial
from sensor_msgs.msg import Imu

from shsa_core.ros.node import run
from shsa_rover.covariance import diagonal
from shsa_rover.imu_sentence import ImuReading, Parser
from shsa_rover.ros.gateway import Gateway
from shsa_rover.ros.parameters import text_parameter
from shsa_rover.sensors import SensorParameters


def serve() -> None:
    """Publishes the newest reading, with its time of arrival, until the node shuts down."""
    sensors = SensorParameters()
    gyroscope = diagonal(3, {2: sensors.gyroscope_variance})
    accelerometer = diagonal(3, {0: sensors.accelerometer_variance})
    publisher = rospy.Publisher("imu/data", Imu, queue_size=10)

    def take(_: serial.Serial, readings: List[ImuReading]) -> None:
        imu = Imu()
        imu.header.stamp = rospy.Time.now()
        imu.header.frame_id = "imu_link"
        imu.orientation.w = 1.0
        imu.orientation_covariance[0] = -1.0
        imu.angular_velocity_covariance = gyroscope
        imu.linear_acceleration_covariance = accelerometer
        imu.angular_velocity.z = readings[-1].turn_rate
        imu.linear_acceleration.x = readings[-1].specific_force
        publisher.publish(imu)

    Gateway("IMU", text_parameter("~port"), Parser(), take).run()


def main() -> None:
    """The node's entry point."""
    run("imu", serve)

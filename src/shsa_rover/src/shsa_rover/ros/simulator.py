"""`rover_simulator`: stands for the rover's hardware, in real time."""
import math
import time
from dataclasses import asdict, replace

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry as OdometryMessage
from sensor_msgs.msg import Imu
from shsa_msgs.msg import Float64Stamped
from std_msgs.msg import Float64

from shsa_core.ros.node import run
from shsa_rover.covariance import diagonal
from shsa_rover.frame import encode
from shsa_rover.pseudo_terminal import PseudoTerminal
from shsa_rover.ros.parameters import flag_parameter, number_parameter, text_parameter
from shsa_rover.rover import Rover, Truth
from shsa_rover.sensors import Readings, SensorParameters
from shsa_rover.worlds import GREATEST_PAYLOAD, STEEPEST, World, named_world

STEP_S = 0.01
STEPS_PER_SAMPLE = 2
LONGEST_BACKLOG_S = 0.5


def world_parameters(seed: int) -> World:
    """Return the world of the name in `~world`, with what other parameters say of it."""
    world = named_world(text_parameter("~world", "as_fitted"), seed)
    return replace(
        world,
        payload=number_parameter("~payload", world.payload, 0.0, GREATEST_PAYLOAD),
        floor=text_parameter("~floor", world.floor),
        slope=number_parameter("~slope", world.slope, 0.0, STEEPEST),
        state_of_charge=number_parameter("~state_of_charge", world.state_of_charge, 0.05, 1.0),
    )


class Simulator:
    """Steps the rover, feeds the sensor nodes, and plays the microcontroller on its port."""

    def __init__(self) -> None:
        seed = int(number_parameter("~seed", 0, 0, 2**31))
        self._rover = Rover(seed, world=world_parameters(seed))
        self._checked = flag_parameter("~checksum", False)
        sensors = SensorParameters()
        self._wheels = diagonal(6, {0: sensors.velocity_variance, 5: sensors.turn_rate_noise**2})
        self._gyroscope = diagonal(3, {2: sensors.gyroscope_variance})
        self._accelerometer = diagonal(3, {0: sensors.accelerometer_variance})
        self._odometry = rospy.Publisher("hardware/pose", OdometryMessage, queue_size=10)
        self._imu = rospy.Publisher("hardware/imu", Imu, queue_size=10)
        self._voltage = rospy.Publisher("hardware/battery_voltage", Float64, queue_size=10)
        self._truth = {
            name: rospy.Publisher(f"simulation/{name}", Float64Stamped, queue_size=10)
            for name in Truth.__dataclass_fields__
        }
        # rospy calls back from a thread of its own: the command is one tuple, so that it changes as
        # a whole.
        self._command = (0.0, 0.0, 0)
        self._commands_seen = 0
        rospy.Subscriber("cmd_vel", Twist, self._on_command, queue_size=1)

    def run(self) -> None:
        """Runs until the node shuts down; the line's link is removed at the end."""
        line = PseudoTerminal(text_parameter("~port"))
        rospy.loginfo("The simulated rover is ready. Its microcontroller is at %s.", line.link)
        try:
            self._loop(line)
        finally:
            line.close()

    def _loop(self, line: PseudoTerminal) -> None:
        period = STEP_S * STEPS_PER_SAMPLE
        due = time.monotonic()
        while not rospy.is_shutdown():
            self._sample(line)
            due += period
            wait = due - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            elif -wait > LONGEST_BACKLOG_S:
                rospy.logwarn("The simulation was held up for %.1f s, which it skips.", -wait)
                due = time.monotonic()

    def _sample(self, line: PseudoTerminal) -> None:
        velocity, turn_rate, number = self._command
        if number != self._commands_seen:
            self._commands_seen = number
            self._rover.command(velocity, turn_rate)
        for _ in range(STEPS_PER_SAMPLE):
            self._rover.step(STEP_S)
        readings = self._rover.measure()
        line.write(encode([readings.current_counts], self._checked))
        stamp = rospy.Time.now()
        self._publish_readings(readings, stamp)
        for name, value in asdict(self._rover.truth()).items():
            publisher = self._truth[name]
            if publisher.get_num_connections():
                message = Float64Stamped(data=value)
                message.header.stamp = stamp
                publisher.publish(message)

    def _publish_readings(self, readings: Readings, stamp: rospy.Time) -> None:
        odometry = OdometryMessage()
        odometry.header.stamp = stamp
        odometry.header.frame_id = "odom"
        odometry.child_frame_id = "base_link"
        odometry.pose.pose.orientation.w = 1.0
        odometry.twist.twist.linear.x = readings.wheel_velocity
        odometry.twist.twist.angular.z = readings.wheel_turn_rate
        odometry.pose.covariance = diagonal(6, {})
        odometry.twist.covariance = self._wheels
        self._odometry.publish(odometry)
        imu = Imu()
        imu.header.stamp = stamp
        imu.header.frame_id = "imu_link"
        imu.orientation.w = 1.0
        imu.orientation_covariance[0] = -1.0
        imu.angular_velocity_covariance = self._gyroscope
        imu.linear_acceleration_covariance = self._accelerometer
        imu.angular_velocity.z = readings.gyroscope
        imu.linear_acceleration.x = readings.accelerometer
        self._imu.publish(imu)
        self._voltage.publish(Float64(readings.battery_voltage))

    def _on_command(self, message: Twist) -> None:
        velocity, turn_rate = message.linear.x, message.angular.z
        if math.isfinite(velocity) and math.isfinite(turn_rate):
            self._command = (velocity, turn_rate, self._command[2] + 1)
        else:
            rospy.logwarn_throttle(5.0, "A command that is not a number is ignored.")


def main() -> None:
    """The node's entry point."""
    run("rover_simulator", lambda: Simulator().run())

"""`voltmeter`: the battery's voltage from the motor controller."""
import rospy
from shsa_msgs.msg import Float64Stamped
from std_msgs.msg import Float64

from shsa_core.ros.node import publish, run
from shsa_rover.sensors import SensorParameters


def serve() -> None:
    """Publishes what the hardware says, with the time of its arrival."""
    variance = SensorParameters().voltage_variance
    publisher = rospy.Publisher("battery_voltage", Float64Stamped, queue_size=10)

    def forward(reading: Float64) -> None:
        message = Float64Stamped(data=reading.data, variance=variance)
        message.header.stamp = rospy.Time.now()
        message.header.frame_id = "battery"
        publish(publisher, message)

    rospy.Subscriber("hardware/battery_voltage", Float64, forward, queue_size=1, tcp_nodelay=True)
    rospy.spin()


def main() -> None:
    """The node's entry point."""
    run("voltmeter", serve)

"""A node that publishes large messages at a steady rate, as a camera does.

Usage: large_source.py TOPIC BYTES PERIOD: publishes a sensor_msgs/Image with so many bytes of data
every PERIOD s. It is serialised once.
"""
import io
import sys
import time

import rospy
from rospy.exceptions import TransportException
from rospy.msg import serialize_message
from sensor_msgs.msg import Image


def main(topic: str, size: int, period: float) -> None:
    """Publish until ROS shuts down."""
    rospy.init_node("large_source")
    publisher = rospy.Publisher(topic, Image, tcp_nodelay=True, queue_size=0)
    message = Image(data=bytes(size))
    message.header.stamp = rospy.Time.now()
    buffer = io.BytesIO()
    serialize_message(buffer, 0, message)
    data = buffer.getvalue()
    due = time.monotonic()
    while not rospy.is_shutdown():
        time.sleep(max(0.0, due - time.monotonic()))
        due = max(due + period, time.monotonic())
        for connection in publisher.impl.connections:
            try:
                connection.write_data(data)
            except (TransportException, OSError):
                publisher.impl.remove_connection(connection)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))

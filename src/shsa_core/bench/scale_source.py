"""A node that publishes many topics as cheaply as Python can: the load for `scale.py`.

Usage: scale_source.py FIRST TOPICS PERIOD NUMBERS: publishes /scale_FIRST and those after it as
std_msgs/Float64MultiArray of so many numbers, each every PERIOD s, evenly spread over time. The
message is serialised once for all.
"""
import io
import sys
import time

import rospy
from rospy.exceptions import TransportException
from rospy.msg import serialize_message
from std_msgs.msg import Float64MultiArray


def main(first: int, topics: int, period: float, numbers: int) -> None:
    """Publish until ROS shuts down."""
    rospy.init_node("scale_source")
    publishers = [
        rospy.Publisher(f"/scale_{number}", Float64MultiArray, tcp_nodelay=True, queue_size=0)
        for number in range(first, first + topics)
    ]
    buffer = io.BytesIO()
    serialize_message(buffer, 0, Float64MultiArray(data=[1.0] * numbers))
    data = buffer.getvalue()
    step, due, sent = period / topics, time.monotonic(), 0
    while not rospy.is_shutdown():
        rest = due - time.monotonic()
        if rest > 0.0:
            time.sleep(rest)
        due += step
        if rest < -period:
            due -= rest  # what could not be sent in time is left out, as rospy.Rate does
        publisher = publishers[sent % topics].impl
        for connection in publisher.connections:
            try:
                connection.write_data(data)
            except (TransportException, OSError):
                publisher.remove_connection(connection)
        sent += 1


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))

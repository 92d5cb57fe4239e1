"""A node that publishes many topics at a steady rate, cheaply: the load for measurements.

Usage: stream_source.py TOPICS PERIOD [FIRST]: publishes TOPICS topics from /stream_FIRST on (0 if
not given) as shsa_msgs/Float64Stamped, each every PERIOD s, evenly spread over time. A message is
serialised once for all of its subscribers, and carries the monotonic time in s at which it was
sent.
"""
import io
import sys
import time
from typing import List

import rospy
from rospy.exceptions import TransportException
from rospy.msg import serialize_message
from shsa_msgs.msg import Float64Stamped


def send(publisher: rospy.Publisher, message: Float64Stamped, count: int) -> None:
    """Write a message to every subscriber in this thread, without rospy's queue."""
    buffer = io.BytesIO()
    serialize_message(buffer, count, message)
    for connection in publisher.impl.connections:
        try:
            connection.write_data(buffer.getvalue())
        except (TransportException, OSError):
            publisher.impl.remove_connection(connection)


def main(topics: int, period: float, first: int = 0) -> None:
    """Publish until ROS shuts down."""
    rospy.init_node("stream_source")
    publishers: List[rospy.Publisher] = [
        rospy.Publisher(f"/stream_{first + i}", Float64Stamped, tcp_nodelay=True, queue_size=0)
        for i in range(topics)
    ]
    message = Float64Stamped()
    step = period / topics
    due = time.monotonic()
    sent = 0
    while not rospy.is_shutdown():
        rest = due - time.monotonic()
        if rest > 0.0:
            time.sleep(rest)
        due += step
        if rest < -period:
            due -= rest  # what could not be sent in time is left out, as rospy.Rate does
        message.data = time.monotonic()
        message.header.stamp = rospy.Time.now()
        send(publishers[sent % topics], message, sent // topics)
        sent += 1


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), *map(int, sys.argv[3:4]))

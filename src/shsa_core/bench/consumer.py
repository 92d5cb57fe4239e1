"""A consumer in rospy: prints its messages and the publishers it contacts, with the monotonic time.

Usage: consumer.py TOPIC...  Lines: `message TIME TOPIC NODE VALUE STAMP FRAME` and
`connection TIME TOPIC URI`, TIME and STAMP in s.
"""
import os
import sys
import time
from typing import Any

import rospy
from shsa_msgs.msg import Float64Stamped


def say(line: str) -> None:
    """Write a line at once and whole: several threads do."""
    os.write(1, (line + "\n").encode())


def received(message: Float64Stamped, topic: str) -> None:
    """Print a message."""
    now = time.monotonic()
    node = message._connection_header["callerid"]
    stamp, frame = message.header.stamp.to_sec(), message.header.frame_id
    say(f"message {now:.6f} {topic} {node} {message.data:g} {stamp:.6f} {frame}")


def listen(topic: str) -> None:
    """Subscribe a topic; rospy tells in no other way whom it contacts."""
    subscriber = rospy.Subscriber(topic, Float64Stamped, received, topic, tcp_nodelay=True)
    add = subscriber.impl.add_connection

    def added(connection: Any) -> Any:
        now = time.monotonic()
        say(f"connection {now:.6f} {topic} {connection.endpoint_id}")
        return add(connection)

    subscriber.impl.add_connection = added


if __name__ == "__main__":
    rospy.init_node("consumer", anonymous=True)
    for name in rospy.myargv(sys.argv)[1:]:
        listen(name)
    rospy.spin()

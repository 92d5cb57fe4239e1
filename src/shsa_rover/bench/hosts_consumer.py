"""A consumer of the current on one of the robot's computers: prints what it hears.

Lines `TIME NODE SEQ AGE`: the monotonic time of receipt in s, the publisher, its number of the
message, and how old the message's stamp was, in s.
"""
import os
import time

import rospy
from shsa_msgs.msg import Float64Stamped


def received(message: Float64Stamped) -> None:
    """Print a message; at once and whole, as several threads do."""
    now = time.monotonic()
    age = time.time() - message.header.stamp.to_sec()
    node = message._connection_header["callerid"]
    os.write(1, f"{now:.6f} {node} {message.header.seq} {age:.6f}\n".encode())


if __name__ == "__main__":
    rospy.init_node("hosts_consumer")
    rospy.Subscriber("battery_current", Float64Stamped, received, tcp_nodelay=True, queue_size=9999)
    rospy.spin()

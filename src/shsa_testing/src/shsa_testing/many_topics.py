"""A node of many topics: `python3 -m shsa_testing.many_topics FIRST COUNT PERIOD`.

The node /many_FIRST publishes shsa_msgs/Float64Stamped on /stream_FIRST, ...; PERIOD in s.
"""
import sys
import time

import rospy
from shsa_msgs.msg import Float64Stamped


def main(first: int, count: int, period: float) -> None:
    """Publish until the node is asked to end."""
    rospy.init_node(f"many_{first}")
    publishers = [
        rospy.Publisher(f"/stream_{number}", Float64Stamped, queue_size=10, tcp_nodelay=True)
        for number in range(first, first + count)
    ]
    due = time.monotonic()
    while not rospy.is_shutdown():
        for publisher in publishers:
            message = Float64Stamped(data=1.0)
            message.header.stamp = rospy.Time.now()
            publisher.publish(message)
        due = max(due + period, time.monotonic())
        rospy.rostime.wallsleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))

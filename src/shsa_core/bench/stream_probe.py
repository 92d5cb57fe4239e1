"""A consumer of /stream_0, /stream_1, ...: notes when each message was sent and when it came.

Usage: stream_probe.py FILE TOPICS SECONDS: writes an array of rows (topic's number, sent, received)
to FILE (.npy).
"""
import struct
import sys
import time
from typing import List, Tuple

import numpy as np
import rospy


def main(path: str, topics: int, seconds: float) -> None:
    """Listen for some seconds, then write."""
    rows: List[Tuple[float, float, float]] = []

    def received(message: rospy.AnyMsg, topic: int) -> None:
        now = time.monotonic()
        rows.append((topic, struct.unpack("<d", message._buff[-8:])[0], now))

    rospy.init_node("stream_probe")
    for topic in range(topics):
        rospy.Subscriber(f"/stream_{topic}", rospy.AnyMsg, received, topic, tcp_nodelay=True)
    rospy.rostime.wallsleep(seconds)
    np.save(path, np.array(rows))


main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))

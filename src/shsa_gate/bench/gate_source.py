"""A node behind a gate that fails in seeded ways: `gate_source.py FAULTS SEED PERIOD_S`.

A good value is the number of the message, from 1 on. Each fault lasts for some messages; then as
many good ones follow as the node needs to be believed again.
"""
import random
import sys
from typing import Tuple

import rospy
from shsa_msgs.msg import Float64Stamped
from std_msgs.msg import Header

JUMPED, OLD = 140000.0, 130000.0
"""Values within the range that a jump has, and a message with an old stamp."""
OLD_S = 10.0
VALUES = {
    "nan": float("nan"),
    "infinite": float("inf"),
    "too high": 1e9,
    "too low": -1.0,
    "jump": JUMPED,
    "old stamp": OLD,
}
OTHERS = ("silent", "late", "too fast")
LONGEST, BETWEEN = 6, 14
BURST = 20


class Source:
    """Publishes a message at a time."""

    def __init__(self, period: float) -> None:
        self.period = period
        self.count = 0
        self.publisher = rospy.Publisher(
            "/gated/raw", Float64Stamped, queue_size=100, tcp_nodelay=True
        )
        self.due = rospy.get_time()

    def wait(self, periods: float = 1.0) -> None:
        """Until the next message is due."""
        self.due += periods * self.period
        rospy.rostime.wallsleep(max(0.0, self.due - rospy.get_time()))

    def publish(self, value: float = 0.0, old: float = 0.0) -> None:
        """A value, or the number of the message."""
        self.count += 1
        stamp = rospy.Time.from_sec(rospy.get_time() - old)
        message = Float64Stamped(header=Header(stamp=stamp), data=value or float(self.count))
        self.publisher.publish(message)

    def good(self, messages: int) -> None:
        """Publish well."""
        for _ in range(messages):
            self.wait()
            self.publish()

    def fail(self, fault: Tuple[str, int]) -> None:
        """Fail for some messages."""
        kind, messages = fault
        if kind == "silent":
            self.wait(messages)
        elif kind == "late":
            self.wait(random.random())
            self.publish()
        elif kind == "too fast":
            for _ in range(BURST * messages):
                self.wait(1.0 / BURST)
                self.publish()
        else:
            for _ in range(messages):
                self.wait()
                self.publish(VALUES[kind], OLD_S if kind == "old stamp" else 0.0)


def main() -> None:
    """Fail so often, in an order that the seed gives."""
    faults, seed, period = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    rospy.init_node("source")
    random.seed(seed)
    kinds = (*VALUES, *OTHERS)
    plan = [(kinds[i % len(kinds)], random.randint(1, LONGEST)) for i in range(faults)]
    random.shuffle(plan)
    source = Source(period)
    source.good(100)
    for fault in plan:
        source.fail(fault)
        source.good(BETWEEN)


if __name__ == "__main__":
    main()

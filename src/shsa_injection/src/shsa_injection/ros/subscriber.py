"""A subscriber of a topic, to be stopped; it ends with its standard input."""
import json
import sys
import threading

import rospy

from shsa_injection.ros.leaving import leave_in_time


def main(topic: str, seconds: float) -> None:
    """Subscribe, say so once a message has come or `seconds` have passed, and stay."""
    rospy.init_node("hung_subscriber", anonymous=True, disable_signals=True)
    heard = threading.Event()
    rospy.Subscriber(topic, rospy.AnyMsg, lambda message: heard.set(), queue_size=1)
    connected = heard.wait(seconds)
    print(json.dumps({"node": rospy.get_name(), "connected": connected}), flush=True)
    sys.stdin.read()
    leave_in_time()
    rospy.signal_shutdown("the fault is over")


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))

"""A stranger that publishes garbage on a topic; it ends with its standard input.

Started with one JSON line: `topic`, `type`, `values` (field and range), `period`, `seed`, and
`name`, which it claims in its connections, empty: its own. It is registered by its own.
"""
import json
import sys
import threading
import time
from typing import Any, Dict

import rospy

from shsa_core.message_types import message_class
from shsa_core.ros.master.announce import announce
from shsa_core.ros.master.node_api import FAILURES
from shsa_injection.faults import USUAL_PERIOD_S, Reading, Stream, message_fault
from shsa_injection.inside.values import FaultyValue
from shsa_injection.ros.leaving import leave_in_time

EXAMPLE_S = 1.0  # s to wait for a message of the topic, to begin with its frames and names


def main() -> None:
    """Publish until the standard input ends."""
    order = json.loads(sys.stdin.readline())
    rospy.init_node("stranger", anonymous=True, disable_signals=True)
    kind = message_class(order["type"])
    try:
        message = rospy.wait_for_message(order["topic"], kind, EXAMPLE_S)
    except rospy.ROSException:
        message = kind()
    headers: Dict[str, str] = {"callerid": order["name"]} if order["name"] else {}
    publisher = rospy.Publisher(order["topic"], kind, headers=headers, queue_size=10)
    try:
        announce(order["topic"], order["type"])
    except FAILURES as error:
        rospy.logwarn("The master does not answer: %s", error)
    threading.Thread(target=_publish, args=(publisher, message, order), daemon=True).start()
    print(json.dumps({"node": rospy.get_name()}), flush=True)
    sys.stdin.read()
    leave_in_time()
    rospy.signal_shutdown("the fault is over")


def _publish(publisher: rospy.Publisher, message: Any, order: Dict[str, Any]) -> None:
    values = [FaultyValue(type(message), field) for field, _ in order["values"]]
    ranges = tuple(None for _ in values)
    garbage = message_fault("garbage", order["seed"], Stream(order["period"], ranges))
    period = order["period"] or USUAL_PERIOD_S
    while not rospy.is_shutdown():
        ((_, reading),) = garbage.feed(0.0, Reading((0.0,) * len(values)))
        for value, number in zip(values, reading.values):
            value.set(message, number or 0.0)
        if message._has_header:
            message.header.stamp = rospy.Time.now()
        publisher.publish(message)
        time.sleep(period)


if __name__ == "__main__":
    main()

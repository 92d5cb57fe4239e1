"""A stranger on a topic: `stranger publish`, or `stranger subscribe TOPIC SECONDS`.

It ends with its standard input. One that publishes is told one JSON line first: `topic`, `type`,
`values` (field and range), `period`, `seed`, and `name`, which it claims in its connections, empty:
its own. It is registered by its own.
"""
import json
import os
import sys
import threading
import time
from typing import Any, Dict, List

import rospy

from shsa_core.message_types import message_class
from shsa_core.ros.master.announce import remind
from shsa_core.ros.master.node_api import FAILURES
from shsa_injection.faults import USUAL_PERIOD_S, Reading, Stream, message_fault
from shsa_injection.inside.values import FaultyValue

EXAMPLE_S = 1.0  # s to wait for a message of the topic, to begin with its frames and names
LONGEST_S = 2.0  # s that leaving may take: a master that is gone does not answer


def main(words: List[str]) -> None:
    """Publish garbage, or subscribe, until the standard input ends."""
    if words[0] == "publish":
        publish()
    else:
        subscribe(words[1], float(words[2]))
    sys.stdin.read()
    timer = threading.Timer(LONGEST_S, os._exit, args=(0,))
    timer.daemon = True
    timer.start()
    rospy.signal_shutdown("the fault is over")


def subscribe(topic: str, seconds: float) -> None:
    """Subscribe; say so once a message has come or `seconds` have passed."""
    rospy.init_node("hung_subscriber", anonymous=True, disable_signals=True)
    heard = threading.Event()
    rospy.Subscriber(topic, rospy.AnyMsg, lambda message: heard.set(), queue_size=1)
    connected = heard.wait(seconds)
    print(json.dumps({"node": rospy.get_name(), "connected": connected}), flush=True)


def publish() -> None:
    """Publish garbage, as the line on standard input says, in a thread of its own."""
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
        remind([order["topic"]], lambda topic: frozenset())
    except FAILURES as error:
        rospy.logwarn("The master does not answer: %s", error)
    threading.Thread(target=_publish, args=(publisher, message, order), daemon=True).start()
    print(json.dumps({"node": rospy.get_name()}), flush=True)


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
    main(sys.argv[1:])

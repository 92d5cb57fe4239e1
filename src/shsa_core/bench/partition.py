"""A link to another computer, made of namespaces, goes down and comes up again: a publisher there.

Its backlog reaches consumers whatever healing does. What counts is what healing makes of it. Prints
one JSON object: `backlog`, messages of the original that were older than its deadline as they were
heard; `taken_for_good`, how many of them came after its return was noticed; `overlap`: s from its
first message that is not late to the substitute's last one; `gap`, the longest pause in s between
messages until the return; `kinds` of failures; `killed`, whether the original was ended; `state` of
the incident. Needs the right to make namespaces.
"""
import argparse
import sys
import time
from typing import List, Tuple

import rospy
from shsa_msgs.msg import Failure, Float64Stamped

from far_graph import print_measured
from graph import FAULTY_PUBLISHER, PACKAGE, PATIENCE_S, Graph
from shsa_core.ros import clock
from shsa_testing.computers import Computer
from shsa_testing.healing import moment_of
from shsa_testing.waiting import wait_until

TOPIC, NODE, SOURCE = "/hot", "/hot_node", "/source_node"
DEADLINE_S = 0.25
SETTLED_S = 3.0


def measure(graph: Graph, far: Computer, seconds: float) -> object:
    """Take the link down for so long, and look what comes of it."""
    heard: List[Tuple[float, str, float]] = []  # when, from whom, how old
    kinds: List[str] = []

    def received(message: Float64Stamped) -> None:
        age = rospy.get_time() - message.header.stamp.to_sec()
        heard.append((clock.now(), message._connection_header["callerid"], age))

    python = (sys.executable, str(FAULTY_PUBLISHER))
    graph.start(*python, "_topic:=/source", f"__name:={SOURCE[1:]}")
    arguments = (f"_topic:={TOPIC}", "_value:=10.0", f"__name:={NODE[1:]}")
    original = graph.start(*far.words(*python, *arguments))
    data = PACKAGE / "test" / "data"
    graph.start(
        *("roslaunch", "shsa_core", "shsa.launch", "hold_off:=1.0", "startup_grace:=120"),
        *(f"ontology:={data / 'takeover.yaml'}", f"som:={data / 'takeover_som.yaml'}"),
    )
    rospy.Subscriber(TOPIC, Float64Stamped, received, tcp_nodelay=True, queue_size=10000)
    rospy.Subscriber("/shsa/failures", Failure, lambda each: kinds.append(each.kind))
    healing = graph.healing
    healing.await_available(TOPIC, seconds=PATIENCE_S)
    hot = lambda: any(row.service == "hot" for row in healing.substitutions)
    wait_until(hot, PATIENCE_S, "a hot substitute")
    time.sleep(SETTLED_S)
    kinds.clear()
    down = clock.now()
    far.link.cut()
    healing.await_state(TOPIC, "healed", PATIENCE_S)
    wait_until(lambda: clock.now() > down + seconds, seconds + PATIENCE_S, "the link is down")
    far.link.restore()
    up = clock.now()
    state = healing.await_state(TOPIC, "ended", PATIENCE_S + seconds).state
    returned = moment_of(healing.latest(TOPIC).returned)  # type: ignore[union-attr]
    late = [at for at, who, age in heard if who == NODE and at > up and age > DEADLINE_S]
    times = [down, *(at for at, _, age in heard if down < at < returned and age < DEADLINE_S)]
    fresh = next(at for at, who, age in heard if who == NODE and at > up and age < DEADLINE_S)
    others = [at - fresh for at, who, _ in heard if who != NODE and at > fresh]
    return {
        "seconds": seconds,
        "backlog": len(late),
        "taken_for_good": sum(at >= returned for at in late),
        "overlap": round(max(others, default=0.0), 3),
        "gap": round(max(b - a for a, b in zip(times, times[1:])), 3),
        "kinds": sorted(set(kinds)),
        "killed": original.poll() is not None,
        "state": state,
    }


def main() -> int:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2.0, help="how long the link is down")
    options = parser.parse_args()
    print_measured(lambda graph, far: measure(graph, far, options.seconds))
    return 0


if __name__ == "__main__":
    sys.exit(main())

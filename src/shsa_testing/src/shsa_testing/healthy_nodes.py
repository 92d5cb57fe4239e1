"""A node of a healthy robot as a process: what it publishes, and what it does beside that.

    python3 -m shsa_testing.healthy_nodes ROBOT SOM SEED BEGAN NODE

All nodes of a robot compute the same motion, in the same steps since it BEGAN (wall time, s), so
that what they tell agrees, and goes on where it was when one of them is started again.
"""
import heapq
import sys
import time
from random import Random
from typing import Any, Dict, List, Tuple

import actionlib
import rospy
from actionlib.msg import TestAction, TestGoal
from geometry_msgs.msg import TransformStamped
from roslib.message import get_message_class
from shsa_msgs.srv import Release, ReleaseResponse

from shsa_core.files.som_file import load_som
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_testing.healthy_robots import ROBOTS, Values

STEP_S = 0.01
TF_S = 0.05
EVENTS_PER_S = 0.5


class Motion:
    """The motion of a robot, and what each service tells of it."""

    def __init__(self, robot: str, som: Som, seed: str, began: float) -> None:
        self._says = ROBOTS[robot].says(Random(seed))
        self._began, self._steps = began, 0
        self.said: Dict[str, Values] = {each.name: {} for each in som}

    def advance(self, now: float) -> None:
        """Go on until a time."""
        while self._began + (self._steps + 1) * STEP_S <= now:
            self._steps += 1
            for name in self.said:
                self.said[name] = self._says(name, self._steps * STEP_S)


class Voice:
    """One service: publishes what is told of the motion."""

    def __init__(self, service: Service, motion: Motion) -> None:
        self.service, self._motion = service, motion
        self._kind = kind = get_message_class(service.type)
        self._publisher = rospy.Publisher(service.topic, kind, queue_size=10, tcp_nodelay=True)

    def publish(self) -> None:
        """Publish once."""
        message: Any = self._kind()
        for each in self.service.provides:
            put(message, str(each.field), self._motion.said[self.service.name][each.property])
        if hasattr(message, "header"):
            message.header.stamp = rospy.Time.now()
        self._publisher.publish(message)

    def pause(self) -> float:
        """Return the time until the next message, in s."""
        return self.service.period or Random().expovariate(EVENTS_PER_S)


def put(message: Any, path: str, value: float) -> None:
    """Write a field of a message, or an element of an array; what is not finite, too."""
    *owners, last = path.split(".")
    for owner in owners:
        message = getattr(message, owner)
    name, _, place = last.rstrip("]").partition("[")
    if not place:
        setattr(message, name, value)
        return
    array = list(getattr(message, name))
    array[int(place) : int(place) + 1] = [value]
    setattr(message, name, array)


def begin_duties(robot: str, node: str) -> List[Any]:
    """Begin what a node does beyond its SOM; return what has to be kept for that."""
    kind, kept = ROBOTS[robot], []  # type: Tuple[Any, List[Any]]
    own = lambda pairs: [name for name, whose in pairs if whose == node]
    for topic in own(kind.hears):
        if topic.endswith("/goal"):
            kept.append(action_server(topic[: -len("/goal")]))
        elif not topic.endswith("/cancel"):
            rospy.Subscriber(topic, rospy.AnyMsg)
    for name in own(kind.serves):
        rospy.Service(name, Release, lambda _: ReleaseResponse(success=True))
    if "/tf" in own(kind.publishes):
        publisher = rospy.Publisher("/tf", TransformStamped, queue_size=10)
        tell = lambda _: publisher.publish(TransformStamped(child_frame_id=node))
        kept.append(rospy.Timer(rospy.Duration(TF_S), tell))
    return kept


def action_server(name: str) -> actionlib.SimpleActionServer:
    """Return a server of an action that always succeeds."""

    def do(goal: TestGoal) -> None:
        server.set_succeeded()

    server = actionlib.SimpleActionServer(name, TestAction, do, auto_start=False)
    server.start()
    return server


def main(robot: str, path: str, seed: str, began: str, node: str) -> None:
    """Publish until the node is asked to end."""
    som, errors = load_som(path)
    assert not errors
    motion = Motion(robot, som, seed, float(began))
    motion.advance(time.time())
    rospy.init_node(node.rsplit("/", 1)[-1])
    kept = begin_duties(robot, node)
    voices = [Voice(each, motion) for each in som if each.node == node]
    due: List[Tuple[float, int]] = [(time.monotonic(), place) for place in range(len(voices))]
    while not rospy.is_shutdown():
        at, place = due[0]
        rospy.rostime.wallsleep(max(0.0, at - time.monotonic()))
        motion.advance(time.time())
        voices[place].publish()
        later = max(at + voices[place].pause(), time.monotonic())
        heapq.heapreplace(due, (later, place))
    del kept


if __name__ == "__main__":
    main(*sys.argv[1:6])

"""The table of docs/explanation/killing.md: 12 kinds of node, 6 faults, what is done."""
from typing import Any, Dict, NamedTuple, Tuple

import pytest

from core_robot import A, Robot, has, publishing
from shsa_core.healing import events
from shsa_core.healing.events import Where
from test_containment import BOTH, SHARED, WITH_D, changed


class Node(NamedTuple):
    """A kind of node; `ended`: it may be, as nothing is lost with it. `of_a`: what the SOM says."""

    ended: bool
    duties: Tuple[str, ...] = ()
    protected: str = ""
    alone: bool = False  # nothing else gives what it publishes besides
    of_a: Dict[str, Any] = {}


NODES = {
    "pure sensor": Node(True),
    "base driver": Node(False, ("takes /cmd_vel", "broadcasts tf")),
    "tf broadcaster": Node(False, ("broadcasts tf",)),
    "action server": Node(False, ("serves the action /move",)),
    "nodelet manager": Node(False, protected="its process is a nodelet manager"),
    "driver with two topics": Node(False, alone=True),
    "latched map": Node(True, of_a={"period": None, "latched": True}),
    "event source": Node(True, of_a={"period": None}),
    "node of another user": Node(True),
    "node under respawn": Node(True),
    "required node": Node(False, protected='its launch file says required="true"'),
    "node behind a gate": Node(False, of_a={"topic": "/a/raw", "beyond_gate": "/a"}),
}
FAULTS = {
    "dead": ("node_gone", Where.DEAD),
    "hung": ("silent", Where.STOPPED),
    "silent": ("silent", Where.HERE),
    "out of range": ("out_of_range", Where.HERE),
    "not a number": ("not_a_number", Where.HERE),
    "too fast": ("rate_high", Where.HERE),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", NODES)
def test_nothing_is_lost_that_healing_could_have_kept(kind: str, fault: str) -> None:
    node, (failure, where) = NODES[kind], FAULTS[fault]
    gated = "beyond_gate" in node.of_a
    robot = Robot(changed(SHARED, "a", **node.of_a), WITH_D if node.alone else BOTH)
    robot.handle(events.GraphSeen(2.0, (), ((A, node.duties),)))
    robot.handle(events.NodeLearned(2.0, A, True, node.protected))
    topic = node.of_a.get("topic", "/a")
    robot.row(topic, A, "failed", 10.0)
    robot.failure(topic, A, 10.0, failure, "it fails.", 9.98)
    for row in robot.working():
        robot.row(topic, row.node, "healthy", 10.2, first=10.2)
    robot.table(10.2)
    if has(robot.said, events.FindNode):
        robot.handle(events.NodeFound(10.3, A, where))
    quiet = failure in ("node_gone", "silent")
    ended = has(robot.said, events.AskToLeave) or has(robot.said, events.EndProcess)
    assert ended is (node.ended and not quiet)
    if ended and kind == "node of another user":
        robot.handle(events.ProcessUntouchable(10.4, A))
        assert has(robot.said, events.Log) and publishing(robot) == (True,)
        return
    if ended:
        robot.handle(events.NodeLeft(10.4, A))
    assert publishing(robot)[:1] == ((True,) if quiet or ended or gated else ())

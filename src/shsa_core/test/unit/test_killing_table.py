"""The tables of docs/explanation/killing.md: its rows as decisions, and its nodes on a robot."""
from typing import Any, Dict, List, NamedTuple, Tuple

import pytest

from core_robot import A, BOTH, SHARED, WITH_D, Robot, changed, has, publishing
from shsa_core.healing import events
from shsa_core.healing.containment import Charge, decide
from shsa_core.healing.events import Where
from shsa_core.model.kinds import Contain, Kind

WRONG, SILENT = Kind.OUT_OF_RANGE, Kind.SILENT
ROWS: List[Any] = [
    # Everything that is lost is taken over.
    (WRONG, {"replaced": True}, True, "what is needed of it is taken over"),
    (SILENT, {"replaced": True}, False, "it may speak again, and ending it would gain nothing"),
    (Kind.REQUESTED, {"replaced": True}, True, "what is needed of it is taken over"),
    (Kind.RATE_LOW, {"replaced": True}, True, "what is needed of it is taken over"),
    # Something needed is lost for good.
    (WRONG, {"replaced": True, "costs": ("/x",)}, False, "would cost /x, which nothing can"),
    (WRONG, {"replaced": True, "costs": ("/x", "/y")}, False, "would cost /x and /y, which"),
    (WRONG, {"costs": ("/x", "/y", "/z")}, False, "would cost /x, /y and /z, which"),
    (WRONG, {"duties": ("takes /x",), "replaced": True}, False, "it takes /x, which nothing takes"),
    # Nothing takes the failed topic over.
    (WRONG, {}, False, "nothing can replace /a"),
    (Kind.STALE_STAMP, {}, False, "nothing can replace /a"),
    (WRONG, {"safe": True}, True, "nothing but its last resort is left"),
    (WRONG, {"safe": True, "replaced": True}, True, "what is needed of it is taken over"),
    (WRONG, {"safe": True, "costs": ("/x",)}, False, "would cost /x, which nothing can replace"),
    (Kind.NEVER_PUBLISHED, {}, False, "it may speak again, and ending it would gain nothing"),
    (Kind.NODE_GONE, {}, False, "it may speak again, and ending it would gain nothing"),
    (Kind.NODE_GONE, {"replaced": True}, False, "it may speak again, and ending it would gain"),
    (Kind.NODE_GONE, {"restarted": True}, True, "its policy is to start it again"),
    (Kind.REQUESTED, {}, False, "nothing can replace /a"),
    (Kind.REQUESTED, {"safe": True}, False, "nothing can replace /a"),
    # Nobody knows whether the node or the SOM is wrong.
    (WRONG, {"was_good": False}, False, "/a was never good: it may not be ready yet, or the SOM"),
    (Kind.NOT_A_NUMBER, {"was_good": False, "replaced": True}, False, "/a was never good"),
    (WRONG, {"was_good": False, "contain": Contain.NODE}, True, "the SOM says so of /a"),
    (WRONG, {"was_good": False, "restarted": True}, True, "its policy is to start it again"),
    # The SOM, the policy and the process decide otherwise.
    (WRONG, {"contain": Contain.NODE, "costs": ("/x",)}, True, "the SOM says so of /a"),
    (SILENT, {"contain": Contain.NODE}, True, "the SOM says so of /a"),
    (SILENT, {"restarted": True}, True, "if it stays silent: its policy is to start it again"),
    (WRONG, {"contain": Contain.NONE, "replaced": True}, False, "the SOM says so of /a"),
    (WRONG, {"restarted": True, "costs": ("/x",)}, True, "its policy is to start it again"),
    # Its settings may be other ones.
    (Kind.FRAME, {"replaced": True, "restarted": True}, False, "its settings may have been"),
    (Kind.LENGTH, {"gated": True}, False, "its settings may have been changed"),
    (Kind.LENGTH, {"contain": Contain.NODE}, True, "the SOM says so of /a"),
    # A gate stands between it and the consumers.
    (WRONG, {"gated": True, "replaced": True}, False, "a gate keeps from consumers what it"),
    (WRONG, {"gated": True, "contain": Contain.NODE}, True, "the SOM says so of /a"),
    (SILENT, {"gated": True, "replaced": True}, False, "it may speak again, and ending it"),
    (Kind.NODE_GONE, {"gated": True, "replaced": True}, False, "it may speak again, and ending"),
    (Kind.REQUESTED, {"gated": True, "replaced": True}, True, "what is needed of it is taken"),
    (WRONG, {"protected": "it is P", "replaced": True}, False, "/n is kept: it is P"),
    (WRONG, {"protected": "it is P", "restarted": True}, False, "/n is kept: it is P"),
    (WRONG, {"protected": "it is P", "contain": Contain.NODE}, True, "the SOM says so of /a"),
]


@pytest.mark.parametrize("kind, known, kill, why", ROWS)
def test_a_row_of_the_table(kind: Kind, known: Dict[str, Any], kill: bool, why: str) -> None:
    verdict = decide(Charge("/n", "/a", kind, **known))
    assert verdict.kill is kill and why in verdict.why
    gone = kind is Kind.NODE_GONE
    does = ("ended", "left alone") if gone else ("killed", "kept")
    end = " if it still runs: " if gone else ""
    assert verdict.why.startswith(f"/n is {does[0] if kill else does[1]}{end}")


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

"""The end of a kill: a node that does well by then is back, and what it did not fail on stays."""
from dataclasses import replace
from typing import Any, Dict, List, Optional

import pytest
from core_robot import BOTH, SHARED, SOM, A, B, C, Robot, changed, has, only, publishing, service
from hosts_robot import BOARD, PI, distributed, seen, steady

from shsa_core.healing import events
from shsa_core.healing.events import AskToLeave, FindNode, NodeFound, Where
from shsa_core.healing.incident import State
from shsa_core.healing.records import NodeRecord
from shsa_core.model.cost import Host
from shsa_core.model.kinds import Contain, Kind, Policy, Standby
from shsa_core.model.som import Som

RESTARTED = {"policy": Policy.RESTART_AND_SUBSTITUTE}


def goes_on(robot: Robot, begin: float, end: float, *hosts: str) -> List[events.Command]:
    """Time passes; whoever is looked for is found, and sends at its rate."""
    said: List[events.Command] = []
    while begin < end:
        found = [*seen(robot, begin, *hosts), *robot.handle(events.Tick(begin))]
        for each in [each for each in found if isinstance(each, FindNode)]:
            found += robot.handle(NodeFound(begin + 0.1, each.node, Where.HERE, rate=50.0))
        said += found
        begin += 0.25
    return said


@pytest.mark.parametrize("answered", [True, False], ids=["slow", "lost"])
@pytest.mark.parametrize(
    "spec",
    [{}, RESTARTED, {"policy": Policy.RESTART}, {"contain": Contain.NODE}]
    + [{"standby": Standby.HOT}],
)
def test_a_node_that_is_back_before_it_is_found_is_back(
    spec: Dict[str, Any], answered: bool
) -> None:
    """A respawned node was heard before the search was answered, and was ended 8 s later."""
    robot = Robot(changed(SOM, "a", **spec))
    robot.failure("/a", A, 10.0, "node_gone", "it died.", 9.9)
    robot.back(10.6)
    if answered:
        robot.handle(NodeFound(10.7, A, Where.HERE))
    assert not has(goes_on(robot, 11.0, 30.0), AskToLeave)
    assert robot.core.incident("a") is None


@pytest.mark.parametrize("where", [Where.HERE, Where.UNREACHABLE])
@pytest.mark.parametrize("policy", [Policy.SUBSTITUTE, Policy.RESTART])
@pytest.mark.parametrize("looks", [1, 2])
def test_a_node_that_is_at_its_rate_again_as_its_computer_counts_is_back(
    where: Where, policy: Policy, looks: int
) -> None:
    robot = distributed(policy=policy)
    steady(robot, 3.0, 10.0, PI, BOARD)
    robot.row("/a", A, "failed", 10.0, kind=Kind.RATE_LOW, detail="30 Hz")
    robot.table(10.0)
    time = 10.0
    while looks > 1:  # the second tells nothing new
        looks -= 1
        robot.handle(NodeFound(time + 0.5, A, where, rate=50.0))
        while not has(seen(robot, time, PI, BOARD), FindNode):
            time += 0.25
    robot.back(time + 0.3)
    robot.handle(NodeFound(time + 0.6, A, where, rate=50.0))
    assert not has(goes_on(robot, time + 1.0, time + 20.0, PI, BOARD), AskToLeave)
    assert robot.core.incident("a") is None


@pytest.mark.parametrize("topic", ["/d", "/shared"])
@pytest.mark.parametrize(
    "kind, answer",
    [
        ("node_gone", NodeFound(11.1, A, Where.HERE)),
        ("out_of_range", NodeFound(11.1, A, Where.UNKNOWN)),
        ("rate_low", NodeFound(11.1, A, Where.HERE, rate=50.0)),
    ],
)
def test_a_kill_for_one_topic_leaves_alone_for_what_its_node_is_kept(
    topic: str, kind: str, answer: NodeFound
) -> None:
    """A second voice spoke there beside the node, or processes were started in vain."""
    kept = service("d", A, True, topic=topic, host=PI, contain=Contain.NONE)
    mine, *_, other = SHARED.services.values()
    som = Som([replace(mine, host=PI), kept, other, service("c", C, topic=topic)], [Host(PI, 4.0)])
    robot = Robot(som, BOTH)
    steady(robot, 1.0, 10.0, PI)
    for time, failed, how in ((10.0, topic, "out_of_range"), (11.0, "/a", kind)):
        robot.row(failed, A, "failed", time)
        robot.failure(failed, A, time, how, "seen.", time - 0.1)
    robot.handle(answer)
    goes_on(robot, 12.0, 30.0, PI)
    assert {row.service for row in robot.working()} <= {"a"}
    incident = robot.core.incident("d")
    assert incident is not None and incident.state is State.KEPT


def test_a_node_that_could_not_be_ended_still_gives_its_other_topics() -> None:
    """They counted as unavailable for good, and nothing was computed from them."""
    som = Som([service("a", A, True), service("b", A), service("d", C, True), service("c", B)])
    robot = Robot(som, BOTH)
    robot.row("/a", A, "failed", 10.0)
    robot.failure("/a", A, 10.0, "out_of_range", "a is 99.", 9.9)
    robot.killed(10.1, A, certain=False)
    robot.fail("/d", C, 20.0)
    assert [row.service for row in robot.working()] == ["a", "d"]


@pytest.mark.parametrize(
    "spec", [{"contain": Contain.NONE}, {"policy": Policy.ADVISE}, {"policy": Policy.SUBSTITUTE}]
)
def test_a_kill_that_waits_is_no_more_when_the_som_says_another_thing(spec: Dict[str, Any]) -> None:
    som = changed(SOM, "a", **RESTARTED)
    robot = Robot(som)
    robot.row("/a", A, "failed", 10.0)
    robot.failure("/a", A, 10.0, "silent", "no message.", 9.9)
    robot.handle(
        events.SomChanged(10.5, changed(SOM, "a", **{"policy": Policy.SUBSTITUTE, **spec}))
    )
    assert not has(goes_on(robot, 11.0, 30.0), FindNode)
    incident = robot.core.incident("a")
    assert incident is not None and incident.kept
    robot.handle(events.SomChanged(30.0, som))
    assert has(goes_on(robot, 30.0, 33.0), AskToLeave)


@pytest.mark.parametrize("speaks, kind", [(True, "silent"), (False, "silent"), (True, "length")])
def test_a_silent_node_that_speaks_as_it_is_found_is_spared(speaks: bool, kind: str) -> None:
    """It is so for its silence alone."""
    robot = Robot(changed(SOM, "a", contain=Contain.NODE, policy=Policy.RESTART))
    robot.row("/a", A, "failed", 10.0)
    assert has(robot.failure("/a", A, 10.0, kind, "seen.", 9.9), FindNode)
    robot.row("/a", A, "healthy" if speaks else "failed", 10.05)
    robot.table(10.1)
    ended = has(robot.handle(NodeFound(10.2, A, Where.HERE)), AskToLeave)
    assert ended is not (speaks and kind == "silent")
    assert ended or not has(goes_on(robot, 11.0, 30.0), FindNode)


@pytest.mark.parametrize("answer", [None, Where.UNKNOWN, Where.PROTECTED, Where.ANOTHER])
def test_what_somebody_asked_for_is_over_if_the_node_goes_on(answer: Optional[Where]) -> None:
    """Its substitute spoke beside the healthy node."""
    robot = Robot()
    robot.handle(events.SubstituteRequested(10.0, "a"))
    if answer is not None:
        robot.handle(NodeFound(10.1, A, answer, "so it is."))
    robot.handle(events.Tick(12.1))  # it could not be found in time
    assert robot.core.incident("a") is None and not robot.working()
    assert not has(goes_on(robot, 12.2, 30.0), FindNode)


def test_what_somebody_asked_for_goes_on_if_the_node_fails_meanwhile() -> None:
    robot = Robot()
    robot.handle(events.SubstituteRequested(10.0, "a"))
    robot.row("/a", A, "failed", 10.1)
    robot.failure("/a", A, 10.1, "out_of_range", "a is 99.", 10.0)
    robot.killed(10.2, A, certain=False)
    assert publishing(robot) == (True,)


def restarting() -> Robot:
    """Return a robot whose node is gone, and is to be started again."""
    robot = Robot(changed(SOM, "a", policy=Policy.RESTART))
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    return robot


def test_a_node_that_somebody_else_has_started_is_not_started_again() -> None:
    robot = restarting()
    robot.connects(10.3, "/a", A)
    said = goes_on(robot, 10.6, 25.0)
    assert not has(said, events.RestartNode)
    assert has(said, AskToLeave)  # it does not come up
    robot.handle(events.NodeLeft(25.1, A))
    assert has(goes_on(robot, 25.2, 30.0), events.RestartNode)


@pytest.mark.parametrize("state", ["unknown", "healthy"])
def test_a_start_that_is_told_late_to_have_failed_is_not_tried_again(state: str) -> None:
    robot = restarting()
    assert has(robot.handle(events.Tick(10.6)), events.RestartNode)
    robot.row("/a", A, state, 11.0)
    robot.table(11.1)
    robot.handle(events.RestartFailed(11.2, A, "its computer did not answer"))
    (trust,) = [each.trust for each in robot.written.values() if isinstance(each, NodeRecord)]
    assert trust.start_at is None
    assert not has(goes_on(robot, 11.3, 13.5), events.RestartNode)


def test_a_node_that_somebody_else_has_started_and_that_died_is_started() -> None:
    robot = restarting()
    robot.connects(10.3, "/a", A)
    robot.rows.clear()
    robot.table(10.4)
    assert has(robot.handle(events.Tick(10.6)), events.RestartNode)


@pytest.mark.parametrize("policy", [Policy.RESTART, Policy.RESTART_AND_SUBSTITUTE])
@pytest.mark.parametrize("where", [Where.HERE, Where.DEAD])
def test_a_slow_start_is_not_ended_where_the_som_forbids_it(policy: Policy, where: Where) -> None:
    robot = Robot(changed(SOM, "a", policy=policy, contain=Contain.NONE))
    robot.fail("/a", A, 10.0)
    robot.killed(10.01, A)
    assert has(robot.handle(events.Tick(10.6)), events.RestartNode)
    robot.connects(12.0, "/a", A)
    assert not only(robot.handle(events.Tick(20.7)), FindNode).successor
    robot.handle(NodeFound(20.8, A, where))
    if where is Where.DEAD:
        assert has(goes_on(robot, 20.9, 25.0), events.RestartNode)
    else:
        said = goes_on(robot, 20.9, 40.0)
        assert not has(said, AskToLeave) and not has(said, events.RestartNode)
        robot.back(40.0)
        goes_on(robot, 40.1, 43.0)
        assert robot.core.incident("a") is None

"""Healing tries again with pauses, for as long as it takes; and nothing grows meanwhile."""
import gc
import tracemalloc
from math import inf
from typing import List, Tuple

import pytest

from core_robot import A, C, Robot, has, only, service
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Standby
from shsa_core.model.log import Log
from shsa_core.model.som import Som

SHORT, LONG = 350, 650  # what it remembers of the last incidents is full by then
ALLOWED = 30_000
"""Bytes that the core may hold more of after LONG incidents than after SHORT ones."""
WARM = Som([service("a", A, needed=True, standby=Standby.WARM), service("b", "/b_node")])


def incident(robot: Robot, time: float) -> None:
    """From a failure to its end; it takes 10 s."""
    substitute = robot.heal(time)
    robot.row("/a", A, "healthy", time + 2.0)
    robot.rows.pop(("/a", substitute))
    robot.table(time + 2.0)
    robot.handle(events.Tick(time + 4.0))
    robot.handle(events.ProcessExited(time + 4.1, substitute, "late"))
    robot.idle(time + 5.0)
    assert robot.core.incident("a") is None
    robot.said.clear()


def test_the_core_holds_no_more_after_many_incidents() -> None:
    robot = Robot(relapse=0.0)  # it fails again and again here
    held: List[int] = []
    tracemalloc.start()
    for number in range(LONG):
        if number in (SHORT, LONG - 1):
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
        incident(robot, 10.0 * (number + 1))
    tracemalloc.stop()
    assert held[1] - held[0] < ALLOWED, held


def deaths(robot: Robot, count: int) -> List[float]:
    """Return when idle processes are started, each of which dies at once."""
    starts: List[float] = []
    process, time = only(robot.said, events.StartSubstitute).node, 1.0
    for _ in range(count):
        robot.handle(events.ProcessExited(time, process, "[Errno 24] Too many open files"))
        due = robot.core.deadline
        assert due < inf
        starts.append(due - time)
        time = due
        process = only(robot.handle(events.Tick(time)), events.StartSubstitute).node
    return starts


def test_idle_processes_that_cannot_be_made_are_tried_again_ever_more_rarely() -> None:
    assert deaths(Robot(WARM), 7) == [2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0]


@pytest.mark.parametrize("started, what", [(True, "died"), (False, "was not started")])
def test_what_was_never_started_has_not_died(started: bool, what: str) -> None:
    robot, why = Robot(WARM), "[Errno 24] Too many open files"
    process = only(robot.said, events.StartSubstitute).node
    said = robot.handle(events.ProcessExited(1.0, process, why, started))
    assert only(said, Log).text == f"An idle substitute failed: its process {what} ({why})."


def test_nothing_breaks_after_days_without_a_process() -> None:
    """The pauses double; the power of a thousand is no number."""
    assert set(deaths(Robot(WARM), 1200)[6:]) == {60.0}
    robot = Robot(Som([service("a", A, needed=True)]))  # and nothing to heal it with
    robot.fail("/a", A, 10.0)
    robot.killed(10.1, A)
    time = 10.1
    for _ in range(1200):
        due = robot.core.deadline
        assert due < inf
        time = due
        robot.handle(events.Tick(time))
    incident = robot.core.incident("a")
    assert incident is not None and incident.state is State.UNHEALED and time > 60_000.0


def kill_in_vain(robot: Robot, time: float) -> Tuple[float, List[events.Command]]:
    """Nobody answers about the process of a node that is to be killed; when it is tried again."""
    robot.handle(events.Tick(time + 2.0))
    due = robot.core.deadline
    assert due < inf
    return due - time - 2.0, robot.handle(events.Tick(due))


def test_a_kill_for_which_there_were_no_means_is_tried_again() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    pause, commands = kill_in_vain(robot, 10.0)
    assert pause == 2.0 and only(commands, events.FindNode).node == A
    pause, commands = kill_in_vain(robot, 14.0)
    assert pause > 0.0
    while not has(commands, events.FindNode):
        due = robot.core.deadline
        assert due <= 20.0
        commands = robot.handle(events.Tick(due))
    robot.handle(events.NodeFound(20.1, A, events.Where.STOPPED))
    robot.handle(events.NodeLeft(20.2, A))
    incident = robot.core.incident("a")
    assert incident is not None and incident.killed == 20.2


def test_who_is_well_again_is_not_killed_for_what_was() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    robot.handle(events.Tick(12.0))
    robot.row("/a", A, "healthy", 12.5)
    robot.table(12.6)
    for time in (14.0, 14.5, 20.0, 60.0):
        assert not has(robot.handle(events.Tick(time)), events.FindNode)
    assert robot.core.incident("a") is None and C

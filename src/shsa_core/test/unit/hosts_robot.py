"""A robot of several computers, some of which are lost at times."""
from typing import Any, List, Sequence

from core_robot import A, B, C, Robot, service
from shsa_core.healing import events
from shsa_core.model.cost import Host
from shsa_core.model.kinds import OnPartition
from shsa_core.model.som import Som

PI, BOARD = "pi", "board"
WAIT = OnPartition.WAIT


def som(**more: Any) -> Som:
    """A runs on the Pi; what it can be computed from on the board, or on a computer not said."""
    a = service("a", A, needed=True, host=PI, **more)
    b, c = service("b", B, host=BOARD), service("c", C)
    return Som([a, b, c], [Host(PI, 4.0), Host(BOARD, 4.0)])


def seen(robot: Robot, time: float, *hosts: str, load: float = 0.5) -> List[events.Command]:
    """Some computers are heard."""
    commands: List[events.Command] = []
    for host in hosts:
        commands += robot.handle(events.HostSeen(time, host, load, 4.0))
    if robot.core.deadline <= time:
        commands += robot.handle(events.Tick(time))
    return commands


def steady(robot: Robot, begin: float, end: float, *hosts: str) -> List[events.Command]:
    """Some computers are heard all the time."""
    commands: List[events.Command] = []
    while begin < end:
        commands += seen(robot, begin, *hosts)
        begin += 0.5
    return commands


def lost(robot: Robot, time: float, host: str) -> List[events.Command]:
    return robot.handle(events.HostLost(time, host, "its agent is silent."))


def stopped(commands: Sequence[events.Command]) -> List[str]:
    return [each.node for each in commands if isinstance(each, events.StopNode)]


def distributed(*hosts: str, **more: Any) -> Robot:
    """A robot whose computers are heard, and have settled."""
    robot = Robot(som(**more))
    seen(robot, 1.0, *(hosts or (PI, BOARD)))
    robot.handle(events.Tick(3.0))
    robot.idle(3.0)
    return robot


def takes_over(robot: Robot, time: float, node: str = "") -> str:
    """The substitute of A publishes."""
    (row,) = [row for row in robot.working() if row.service == "a"]
    robot.row("/a", row.node, "healthy", time, first=time)
    robot.table(time)
    return row.node


def silent(robot: Robot, time: float, node: str = A) -> List[events.Command]:
    """A is silent, as it is when its computer is cut off."""
    robot.row("/a", node, "failed", time)
    return robot.failure("/a", node, time, "silent", "no message for 0.25 s.", time - 0.25)


def cut(robot: Robot, time: float) -> None:
    """The Pi is cut off: A is silent, it is taken over, and then the loss is known."""
    silent(robot, time + 0.25)
    takes_over(robot, time + 0.3)
    robot.table(time + 0.31)
    lost(robot, time + 1.0, PI)

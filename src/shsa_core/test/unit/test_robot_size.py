"""A decision costs what it concerns: on a large robot it is the same work as on a small one."""
import sys
from pathlib import Path
from typing import Dict

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "bench"))

from simulated_robot import Robot, lines_of  # noqa: E402

from shsa_core.codegen.generator import uses_of  # noqa: E402
from shsa_core.healing import events  # noqa: E402
from shsa_core.healing.settings import Settings  # noqa: E402
from shsa_core.model.health import PublisherState  # noqa: E402
from shsa_core.model.kinds import Standby  # noqa: E402


def work(size: int, standby: Standby, alone: int) -> Dict[str, int]:
    """The lines of Python that each kind of decision executes.

    `alone`: so many hot substitutes have a process each; 0: all.
    """
    uses_of.cache_clear()
    robot = Robot(size, standby, settings=Settings(pool=2, hot_hosts=alone))
    first, second, *_ = robot.som
    robot.time += 100.0
    row = robot.row(second.topic, second.node, PublisherState.HEALTHY)
    change = events.HealthSeen(robot.time, (row,))
    return {
        "tick": lines_of(lambda: robot.send(events.Tick(robot.time))),
        "health change": lines_of(lambda: robot.send(change)),
        "takeover": lines_of(lambda: robot.fail(first.node)),
        "plans": lines_of(robot.plans),
        "return": lines_of(lambda: robot.send(back(robot, first.topic, first.node))),
    }


def back(robot: Robot, topic: str, node: str) -> events.HealthSeen:
    """The node publishes again."""
    return events.HealthSeen(robot.time, (robot.row(topic, node, PublisherState.HEALTHY),))


@pytest.mark.parametrize("alone", [0, 2])
@pytest.mark.parametrize("standby", Standby)
def test_a_decision_is_as_much_work_on_any_robot(standby: Standby, alone: int) -> None:
    small = work(10, standby, alone)
    assert work(300, standby, alone) == small and min(small.values()) > 10


def test_the_count_sees_a_loop_over_everything() -> None:
    def loop(size: int) -> int:
        return sum(number for number in range(size))

    assert lines_of(lambda: loop(300)) > lines_of(lambda: loop(10))

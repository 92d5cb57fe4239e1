"""Minutes of three robots' healthy life: nobody is killed, replaced or blamed."""
from itertools import product
from pathlib import Path

import pytest

from shsa_testing.healthy_robots import RATES, ROBOTS, HealthyRobot
from shsa_testing.thorough import many, some

FILES = Path(__file__).resolve().parent.parent / "data"
MINUTES = 1.5


@pytest.mark.parametrize("seed", range(many(5)))
@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_that_lives_is_left_alone(name: str, seed: int) -> None:
    robot = HealthyRobot(name, FILES, seed)
    found = robot.run(60.0 * MINUTES)
    assert not any(found), found
    assert robot.messages > 2500


@pytest.mark.parametrize("rate, clock", some([*product(RATES, (True, False))], 3))
@pytest.mark.parametrize("name", ROBOTS)
def test_a_rosbag_that_is_played_at_another_rate_is_left_alone(
    name: str, rate: float, clock: bool
) -> None:
    found = HealthyRobot(name, FILES, 0, rate, clock).run(45.0)
    assert not any(found), found


def test_a_node_that_is_gone_is_noticed() -> None:
    robot = HealthyRobot("base", FILES, 0)
    robot.run(300.0)
    assert robot.restarts > 0 and robot.incidents > 0

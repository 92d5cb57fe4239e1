"""Some minutes of three robots' healthy life: nobody is killed, replaced or blamed."""
from pathlib import Path
from typing import Optional

import pytest

from shsa_testing.healthy_robots import RATES, ROBOTS, HealthyRobot
from shsa_testing.thorough import many

FILES = Path(__file__).resolve().parent.parent / "data"
MINUTES = 2.0


@pytest.mark.parametrize("seed", range(many(10)))
@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_that_lives_is_left_alone(name: str, seed: int) -> None:
    robot = HealthyRobot(name, FILES, seed)
    found = robot.run(60.0 * MINUTES)
    assert not any(found), found
    assert robot.messages > 3000


@pytest.mark.parametrize("rate", [rate for rate in RATES if rate])
@pytest.mark.parametrize("name", ROBOTS)
def test_a_rosbag_that_is_played_at_another_rate_is_left_alone(
    name: str, rate: Optional[float]
) -> None:
    found = HealthyRobot(name, FILES, 0, rate).run(60.0)
    assert not any(found), found


def test_a_node_that_is_gone_is_noticed() -> None:
    robot = HealthyRobot("base", FILES, 0)
    robot.run(400.0)
    assert robot.restarts > 0 and robot.incidents > 0

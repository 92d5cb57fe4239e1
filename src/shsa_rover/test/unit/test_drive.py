"""The scripted drive, the keys, and the odometry."""
import math

import pytest

from shsa_core.errors import ModelError
from shsa_rover.drive import SCRIPTED, Drive, Leg, parse_drive
from shsa_rover.covariance import diagonal
from shsa_rover.odometry import Odometry
from shsa_rover.steering import TOP_TURN_RATE, TOP_VELOCITY, Steering


def test_a_drive_follows_its_legs_and_starts_again() -> None:
    legs = (Leg(1.0, 0.5, 0.0), Leg(2.0, 0.0, 1.0))
    drive = Drive(legs)
    times = (0.0, 0.999, 1.0, 2.999, 3.0, 4.5)
    expected = [(0.5, 0.0), (0.5, 0.0), (0.0, 1.0), (0.0, 1.0), (0.5, 0.0), (0.0, 1.0)]
    assert [drive.command(time) for time in times] == expected
    assert Drive(legs, loop=False).command(3.0) == (0.0, 0.0)


def test_the_built_in_drive_has_straights_bends_turns_stops_and_reverse() -> None:
    assert Drive().duration == 30.0
    kinds = {(leg.velocity > 0.0, leg.velocity < 0.0, leg.turn_rate != 0.0) for leg in SCRIPTED}
    assert len(kinds) == 5


def test_a_script_is_read_from_lines() -> None:
    lines = ["# go", "", "2, 0.5, 0\n", " 1.5,0,-1.2 "]
    assert parse_drive(lines, "a.csv") == [Leg(2.0, 0.5, 0.0), Leg(1.5, 0.0, -1.2)]


@pytest.mark.parametrize(
    "line, message",
    [
        ("1, 2", "a.csv:2: '1, 2' is not three numbers"),
        ("1, 2, 3, 4", "is not three numbers"),
        ("fast, 2, 3", "is not three numbers"),
        ("nan, 0, 0", "finite"),
        ("1, inf, 0", "finite"),
        ("0, 1, 1", "duration greater than 0"),
    ],
)
def test_a_bad_line_is_named(line: str, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        parse_drive(["# drive", line], "a.csv")


def test_an_empty_script_is_refused() -> None:
    with pytest.raises(ModelError, match="a.csv: the script has no legs"):
        parse_drive(["# nothing"], "a.csv")


def test_keys_and_arrows_steer() -> None:
    steering = Steering()
    assert steering.press("ww\x1b[A")
    assert steering.velocity == pytest.approx(0.3)
    assert steering.press("\x1b[Da\x1b[C")
    assert steering.turn_rate == pytest.approx(0.2)
    assert steering.press("s" * 30)
    assert steering.velocity == -TOP_VELOCITY
    assert steering.press("A" * 30)
    assert steering.turn_rate == TOP_TURN_RATE
    assert steering.press(" ")
    assert (steering.velocity, steering.turn_rate) == (0.0, 0.0)
    assert not steering.press("wq")


def test_odometry_of_a_circle_comes_back() -> None:
    odometry, turn_rate, rate = Odometry(), 0.5, 50.0
    for number in range(int(rate * 2.0 * math.pi / turn_rate) + 1):
        odometry.update(number / rate, 0.4, turn_rate)
    assert (odometry.x, odometry.y) == (pytest.approx(0.0, abs=0.01), pytest.approx(0.0, abs=0.01))
    assert abs(odometry.heading) < 0.02


def test_odometry_finds_the_acceleration() -> None:
    odometry = Odometry()
    for number in range(100):
        odometry.update(0.02 * number, 0.01 * number, -0.02 * number)
    assert odometry.acceleration == pytest.approx(0.5, rel=1e-6)
    assert odometry.turn_acceleration == pytest.approx(-1.0, rel=1e-6)


@pytest.mark.parametrize("jump", [-5.0, 10.0])
def test_odometry_after_a_jump_in_time_starts_anew_where_it_is(jump: float) -> None:
    odometry = Odometry()
    for number in range(50):
        odometry.update(0.02 * number, 0.5, 0.0)
    x = odometry.x
    odometry.update(0.98 + jump, -0.5, 0.0)
    assert (odometry.x, odometry.acceleration) == (x, 0.0)
    odometry.update(1.0 + jump, -0.5, 0.0)
    assert odometry.x == pytest.approx(x - 0.01)


def test_the_error_of_the_pose_grows_with_the_drive_and_never_is_zero() -> None:
    odometry = Odometry()
    assert odometry.position_error > 0.0 and odometry.heading_error > 0.0
    errors = []
    for number in range(500):
        odometry.update(0.02 * number, 0.5, 0.0, 0.001, 0.004)
        errors.append((odometry.position_error, odometry.heading_error))
    assert errors == sorted(errors)
    # A random walk in the heading: its deviation is the noise of one step, times sqrt(steps).
    assert odometry.heading_error == pytest.approx(0.004 * 0.02 * math.sqrt(499), rel=0.2)
    assert odometry.position_error > 5.0 * 1e-3


def test_an_axis_that_nobody_measures_is_no_certain_one() -> None:
    assert diagonal(3, {2: 0.04}) == [1e6, 0, 0, 0, 1e6, 0, 0, 0, 0.04]

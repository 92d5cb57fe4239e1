"""The simulated rover: its motion, its energy, its sensors and its seed."""
import math
from dataclasses import asdict
from typing import List

import pytest
from hypothesis import given, settings, strategies as st

from shsa_rover.chassis import Chassis, ChassisParameters
from shsa_rover.dataset import random_drive
from shsa_rover.drive import Drive
from shsa_rover.rover import Rover, Truth
from shsa_rover.sensors import TRACK, Readings, SensorParameters, quantised

STEP = 0.01


def drive(rover: Rover, script: Drive, duration: float) -> List[Truth]:
    """Return the rover's states while it drives."""
    states = []
    for number in range(int(duration / STEP)):
        if number % 5 == 0:
            rover.command(*script.command(number * STEP))
        rover.step(STEP)
        states.append(rover.truth())
    return states


def test_the_wheels_work_becomes_motion_and_friction() -> None:
    """Over a drive with every manoeuvre: work = change of kinetic energy + friction."""
    chassis, script, dt = Chassis(), random_drive(3), 0.001
    work = friction = 0.0
    before = chassis.kinetic_energy()
    for number in range(60000):
        chassis.command(*script.command(number * dt))
        chassis.step(dt)
        left, right = chassis.efforts()
        work += (left.force * left.speed + right.force * right.speed) * dt
        turn_rate = chassis.turn.velocity
        friction += dt * (
            chassis.friction(left.speed) * left.speed
            + chassis.friction(right.speed) * right.speed
            + chassis.scrub(chassis.forward.velocity, turn_rate) * turn_rate
        )
    assert friction > 500.0
    assert work == pytest.approx(chassis.kinetic_energy() - before + friction, rel=0.002)


def test_the_battery_pays_for_everything() -> None:
    rover = Rover(seed=4)
    states = drive(rover, Drive(), 60.0)
    paid = sum(s.battery_voltage * s.battery_current for s in states) * STEP
    used = sum(s.battery_power for s in states) * STEP
    assert paid == pytest.approx(used, rel=0.001)
    # More is paid than what arrives at the floor and in the electronics: gears and windings are not
    # free.
    assert used > 1.2 * sum(max(0.0, s.drive_power) for s in states) * STEP + 30.0 * 60.0


@settings(max_examples=30)
@given(st.integers(0, 10**6))
def test_the_motion_stays_within_the_robots_limits(seed: int) -> None:
    p, chassis, script = ChassisParameters(), Chassis(), random_drive(seed, legs=10)
    for number in range(2000):
        chassis.command(*(3.0 * value for value in script.command(number * STEP)))
        chassis.step(STEP)
        assert abs(chassis.forward.velocity) <= p.top_speed * 1.02
        assert abs(chassis.turn.velocity) <= p.top_turn_rate * 1.02
        assert abs(chassis.forward.acceleration) <= p.acceleration_limit + 1e-9
        assert abs(chassis.turn.acceleration) <= p.turn_acceleration_limit + 1e-9


def test_it_reaches_the_velocity_that_it_is_told_and_stops() -> None:
    rover = Rover()
    rover.command(0.5, 0.4)
    for _ in range(199):
        rover.step(STEP)
    assert rover.truth().linear_velocity == pytest.approx(0.5, abs=0.005)
    assert rover.truth().angular_velocity == pytest.approx(0.4, abs=0.005)
    rover.command(0.0, 0.0)
    for _ in range(500):
        rover.step(STEP)
    assert rover.truth().linear_velocity == rover.truth().angular_velocity == 0.0


def test_it_stops_by_itself_when_no_command_comes() -> None:
    rover = Rover()
    rover.command(0.5, 0.0)
    for _ in range(190):
        rover.step(STEP)
    assert rover.truth().linear_velocity > 0.45
    for _ in range(500):
        rover.step(STEP)
    assert rover.truth().linear_velocity == 0.0


def test_turning_on_the_spot_costs_more_than_driving_and_a_wide_bend_little_more() -> None:
    def power(velocity: float, turn_rate: float) -> float:
        rover = Rover()
        for number in range(300):
            rover.command(velocity, turn_rate)
            rover.step(STEP)
        return rover.truth().battery_power

    rest, straight = power(0.0, 0.0), power(0.6, 0.0)
    assert rest == pytest.approx(30.0)
    assert straight > rest + 15.0
    assert power(0.0, 1.0) > straight
    assert straight < power(0.6, 0.05) < straight + 0.3 * (power(0.6, 0.8) - straight)


def test_the_same_seed_gives_the_same_run_and_another_seed_another() -> None:
    def run(seed: int) -> List[Readings]:
        rover, readings = Rover(seed), []
        for state in drive(rover, Drive(), 5.0)[::2]:
            readings.append(rover.measure())
        return readings

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_reading_the_sensors_does_not_change_the_rover() -> None:
    watched, alone = Rover(7), Rover(7)
    for number in range(1000):
        for rover in (watched, alone):
            rover.command(*Drive().command(number * STEP))
            rover.step(STEP)
        watched.measure()
    assert watched.truth() == alone.truth()


def test_the_sensors_tell_the_truth_up_to_noise_and_steps() -> None:
    rover = Rover(5)
    rover.command(0.0, 0.0)
    readings = [rover.measure() for _ in range(4000)]
    truth = rover.truth()
    mean = {
        name: sum(getattr(r, name) for r in readings) / len(readings)
        for name in (*asdict(readings[0]), "battery_voltage")
    }
    assert mean["battery_voltage"] == pytest.approx(truth.battery_voltage, abs=0.005)
    assert mean["gyroscope"] == pytest.approx(0.002, abs=0.001)
    assert mean["accelerometer"] == pytest.approx(0.02, abs=0.003)
    assert all(r.battery_voltage == quantised(r.battery_voltage, 16.5 / 1024) for r in readings)
    assert all(r.left_speed == quantised(r.left_speed, 0.001) for r in readings)
    s = SensorParameters()
    for found, stated in (
        ([r.wheel_velocity for r in readings], s.velocity_variance),
        ([r.wheel_turn_rate for r in readings], s.turn_rate_variance),
    ):
        assert sum(each**2 for each in found) / len(found) == pytest.approx(stated, rel=0.1)
    assert TRACK == 0.39  # as the ontology has it
    spread = [r.accelerometer - mean["accelerometer"] for r in readings]
    assert math.sqrt(sum(s * s for s in spread) / len(spread)) == pytest.approx(0.05, rel=0.1)

"""The simulated rover in worlds that nobody fitted it to."""
import math
from dataclasses import replace
from typing import List, Tuple

import numpy as np
import pytest

from shsa_core.errors import ShsaError
from shsa_rover.chassis import GRAVITY, Chassis, Effort
from shsa_rover.dataset import (
    ACCELEROMETER,
    CURRENT,
    GYROSCOPE,
    TURN_RATE,
    VELOCITY,
    VOLTAGE,
    Dataset,
    random_drive,
    simulate,
)
from shsa_rover.drive import Drive, Leg
from shsa_rover.ground import Ground
from shsa_rover.motors import greatest_force, motor_current, motor_power
from shsa_rover.rover import Rover
from shsa_rover.worlds import AS_FITTED, WORLDS, World, drawn_world, imperfect, named_world

STEP = 0.01
STILL = Drive([Leg(10.0, 0.0, 0.0)])


def settled(world: World, velocity: float, turn_rate: float, seconds: float = 6.0) -> Rover:
    """Return a rover that has long been driving like that."""
    rover = Rover(3, world=world)
    for _ in range(int(seconds / STEP)):
        rover.command(velocity, turn_rate)
        rover.step(STEP)
    return rover


def test_a_world_is_found_by_its_name() -> None:
    assert named_world("as_fitted") == AS_FITTED == World()
    assert {name: named_world(name) for name in WORLDS} == dict(WORLDS)
    assert named_world("drawn", 4) == drawn_world(4)
    with pytest.raises(ShsaError, match="no 'moon', only as_fitted, payload, .* drawn"):
        named_world("moon")


@pytest.mark.parametrize(
    "wrong, named",
    [
        ({"floor": "sand"}, "floor: there is no 'sand', only hard, carpet, smooth"),
        ({"payload": -1.0}, "payload: must be a number from 0 to 30"),
        ({"slope": math.nan}, "slope: must be a number from 0 to 10"),
        ({"state_of_charge": 1.5}, "state_of_charge: must be a number from 0 to 1"),
    ],
)
def test_what_cannot_be_simulated_is_refused(wrong: dict, named: str) -> None:
    with pytest.raises(ShsaError, match=named):
        World(**wrong)


def test_the_seed_draws_the_world() -> None:
    assert drawn_world(1) == drawn_world(1)
    drawn = [drawn_world(seed) for seed in range(30)]
    assert {world.floor for world in drawn} == {"hard", "carpet", "smooth"}
    for one, other in zip(drawn, drawn[1:]):
        for part in ("payload", "slope", "state_of_charge", "body", "motors", "sensors"):
            assert getattr(one, part) != getattr(other, part), part
        assert one.current_sensor != other.current_sensor


def test_what_was_chosen_is_not_drawn() -> None:
    world = imperfect(World(payload=5.0, floor="carpet"), 2)
    assert (world.payload, world.floor, world.slope) == (5.0, "carpet", 0.0)
    assert world.body.slip > 0.0 and world.motors.limited_by_voltage


@pytest.mark.parametrize("world, more", [("payload", True), ("carpet", True), ("smooth", False)])
def test_load_and_floor_change_what_a_drive_costs(world: str, more: bool) -> None:
    for motion in ((0.5, 0.0), (0.0, 1.0)):
        fitted = settled(AS_FITTED, *motion).power
        assert (settled(WORLDS[world], *motion).power > 1.03 * fitted) == more
        assert (settled(WORLDS[world], *motion).power < 0.97 * fitted) != more


def test_hills_are_met_by_the_distance_and_never_too_steep() -> None:
    ground = Ground(math.radians(5.0), 1)
    slopes = np.degrees([ground.slope(0.05 * n) for n in range(-2000, 2000)])
    assert 4.0 < slopes.max() <= 5.0 and -5.0 <= slopes.min() < -4.0
    assert abs(slopes.mean()) < 0.3
    assert ground.slope(7.0) == Ground(math.radians(5.0), 1).slope(7.0)
    assert ground.slope(7.0) != Ground(math.radians(5.0), 2).slope(7.0)
    assert Ground(0.0, 1).slope(7.0) == 0.0


def test_work_on_hills_becomes_motion_friction_and_height() -> None:
    chassis, ground, script, dt = Chassis(), Ground(math.radians(5.0), 2), random_drive(3), 0.001
    work = friction = height = distance = climbed = 0.0
    for number in range(60000):
        chassis.command(*script.command(number * dt))
        distance += chassis.forward.velocity * dt
        chassis.step(dt, slope=ground.slope(distance))
        rise = math.sin(chassis.slope) * chassis.forward.velocity * dt
        height, climbed = height + rise, climbed + abs(rise)
        left, right = chassis.efforts()
        work += (left.force * left.speed + right.force * right.speed) * dt
        turn_rate = chassis.turn.velocity
        friction += dt * (
            chassis.friction(left.speed) * left.speed
            + chassis.friction(right.speed) * right.speed
            + chassis.scrub(chassis.forward.velocity, turn_rate) * turn_rate
        )
    weight = chassis.parameters.mass * GRAVITY
    assert weight * climbed > 100.0
    assert work == pytest.approx(chassis.kinetic_energy() + friction + weight * height, rel=0.002)


def test_the_accelerometer_feels_gravity_on_a_slope() -> None:
    data = simulate(random_drive(1), 60.0, 1, world=WORLDS["slopes"])
    felt = data.measured[ACCELEROMETER] - data.truth["linear_acceleration"]
    gravity = GRAVITY * np.sin(data.truth["slope"])
    assert np.ptp(gravity) > 0.8
    assert np.std(felt - gravity) < 0.06
    assert np.std(felt) > 0.2


def test_friction_holds_a_rover_at_rest_as_far_as_it_can() -> None:
    chassis = Chassis()
    chassis.step(STEP, slope=math.radians(3.0))
    assert [effort.force for effort in chassis.efforts()] == [0.0, 0.0]
    chassis.step(STEP, slope=math.radians(-8.0))
    held = chassis.parameters.mass * GRAVITY * (math.sin(math.radians(8.0)) - 0.08)
    assert sum(effort.force for effort in chassis.efforts()) == pytest.approx(-held)


def test_wheels_slip_and_skid() -> None:
    """The motor controller regulates the wheels: they do as they are told, the rover less."""
    body = replace(AS_FITTED.body, slip=0.1, track_factor=1.25)
    world = World(body=body, floor="carpet")
    for velocity in (0.5, -0.5):
        rover = settled(world, velocity, 0.0)
        true = rover.truth().linear_velocity
        read = np.mean([rover.measure().wheel_velocity for _ in range(200)])
        assert read == pytest.approx(velocity, abs=0.005)
        assert 0.9 < true / velocity < 0.995
    rover = settled(world, 0.0, 1.0)
    truth = rover.truth()
    assert truth.angular_velocity == pytest.approx(0.8, abs=0.005)
    assert truth.right_wheel_velocity - truth.left_wheel_velocity == pytest.approx(
        0.39 * 1.0, abs=0.005
    )


def circuits(world: World, data: Dataset) -> List[Tuple[float, float]]:
    """Return the voltage that each side's motors need to drive on, and the battery's (V)."""
    motors, needed = world.motors, []
    rover = Rover(1, world=world)
    script = random_drive(1)
    for number in range(int(data.time[-1] / STEP)):
        if number % 5 == 0:
            rover.command(*script.command(number * STEP))
        voltage = rover.battery.voltage
        rover.step(STEP)
        for effort in rover.chassis.efforts():
            if effort.force * effort.speed > 0.0:
                emf = motors.force_per_ampere * abs(effort.speed)
                drop = motors.armature_resistance * abs(motor_current(effort, motors))
                needed.append((emf + drop, voltage))
    return needed


def test_nothing_moves_beyond_what_the_voltage_allows() -> None:
    world = imperfect(World(payload=10.0, floor="carpet"), 1)
    data = simulate(random_drive(1), 60.0, 1, world=world)
    needed = circuits(world, data)
    # The force is limited at the speed before each step: what that changes is the tolerance.
    assert max(volts / given for volts, given in needed) < 1.02
    free = replace(world, motors=replace(world.motors, limited_by_voltage=False))
    assert max(volts / given for volts, given in circuits(free, data)) > 1.1


def test_a_flat_battery_makes_a_slow_rover() -> None:
    world = replace(imperfect(World(), 1), state_of_charge=0.1)
    charged = replace(world, state_of_charge=1.0)
    flat, full = (settled(each, 0.7, 1.2).truth() for each in (world, charged))
    assert flat.right_wheel_velocity < full.right_wheel_velocity - 0.01


def test_gears_load_the_windings() -> None:
    fitted, circuit = AS_FITTED.motors, imperfect(AS_FITTED, 1).motors
    push = Effort(50.0, 0.4)
    assert motor_current(push, circuit) == pytest.approx(
        50.0 / circuit.force_per_ampere / circuit.gear_efficiency
    )
    assert motor_power(push, circuit) > motor_power(
        push, replace(circuit, gears_load_windings=False)
    )
    # Back EMF and windings together are the power, as in any circuit.
    current = motor_current(push, circuit)
    emf = circuit.force_per_ampere * push.speed
    assert motor_power(push, circuit) == pytest.approx(
        current * (emf + circuit.armature_resistance * current)
    )
    braking = Effort(-50.0, 0.4)
    assert abs(motor_current(braking, circuit)) < abs(motor_current(braking, fitted))
    assert greatest_force(2.0, 12.0, circuit) == 0.0


def test_every_sensor_has_its_gain_and_offset() -> None:
    world = drawn_world(6)
    s = world.sensors
    data = simulate(random_drive(2), 120.0, 2, world=replace(world, floor="hard"))
    pairs = {
        VOLTAGE: ("battery_voltage", s.voltage_gain, s.voltage_offset),
        GYROSCOPE: ("angular_velocity", s.gyroscope_gain, s.gyroscope_offset),
        TURN_RATE: ("angular_velocity", s.velocity_gain * world.body.track_factor, 0.0),
    }
    for path, (name, gain, offset) in pairs.items():
        error = data.measured[path] - (gain * data.truth[name] + offset)
        assert abs(np.mean(error)) < 0.003, path
    rims = 0.5 * (data.truth["left_wheel_velocity"] + data.truth["right_wheel_velocity"])
    assert np.mean(np.abs(data.measured[VELOCITY] - s.velocity_gain * rims)) < 0.002
    # The amperemeter reads its sensor by the data sheet's typical figures.
    sensor, typical = world.current_sensor, AS_FITTED.current_sensor
    true = data.truth["battery_current"]
    expected = (sensor.zero - typical.zero + sensor.sensitivity * true) / typical.sensitivity
    assert np.mean(data.measured[CURRENT]) == pytest.approx(np.mean(expected), abs=0.01)
    assert np.mean(data.measured[CURRENT]) != pytest.approx(np.mean(true), abs=0.02)


def test_the_state_of_charge_is_the_worlds_unless_it_is_told() -> None:
    world = World(state_of_charge=0.4)
    assert simulate(STILL, 1.0, 0, world=world).truth["state_of_charge"][0] < 0.4
    assert simulate(STILL, 1.0, 0, 0.6, world).truth["state_of_charge"][0] > 0.59

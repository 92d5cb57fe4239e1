"""Recorded drives as columns, 50 rows a second: what the topics carried, and what was true."""
from dataclasses import dataclass, fields
from operator import attrgetter
from random import Random
from typing import List, Mapping, Optional, Tuple

import numpy as np

from shsa_rover.battery import BatteryParameters
from shsa_rover.current_sensor import CurrentSensor
from shsa_rover.drive import Drive, Leg
from shsa_rover.odometry import Odometry
from shsa_rover.rover import Rover, Truth
from shsa_rover.worlds import AS_FITTED, World

PERIOD_S = 0.02
STEPS = 2  # of the simulation, a row
COMMAND_ROWS = 3  # rows between two commands: about the driver's 20 Hz
START_ROWS = 50  # rows that the state of charge is started from

CURRENT = "/battery_current/data"
VOLTAGE = "/battery_voltage/data"
VELOCITY = "/odom/twist/twist/linear/x"
TURN_RATE = "/odom/twist/twist/angular/z"
ACCELERATION = "/drivetrain/accel/accel/linear/x"
TURN_ACCELERATION = "/drivetrain/accel/accel/angular/z"
GYROSCOPE = "/imu/data/angular_velocity/z"
ACCELEROMETER = "/imu/data/linear_acceleration/x"
STATE_OF_CHARGE = "/battery_state/percentage"
COMMANDED_VELOCITY = "/cmd_vel/linear/x"
COMMANDED_TURN_RATE = "/cmd_vel/angular/z"

TOPICS: Mapping[str, Tuple[str, ...]] = {
    "/battery_current": (CURRENT,),
    "/battery_voltage": (VOLTAGE,),
    "/odom": (VELOCITY, TURN_RATE),
    "/drivetrain/accel": (ACCELERATION, TURN_ACCELERATION),
    "/imu/data": (GYROSCOPE, ACCELEROMETER),
    "/battery_state": (STATE_OF_CHARGE,),
    "/cmd_vel": (COMMANDED_VELOCITY, COMMANDED_TURN_RATE),
}


@dataclass(frozen=True)
class Dataset:
    """Columns of equal length, in SI units.

    `time` in s; `measured` by topic and field as in the SOM; `truth` by property, empty for a real
    rover.
    """

    time: np.ndarray
    measured: Mapping[str, np.ndarray]
    truth: Mapping[str, np.ndarray]


def random_drive(seed: int, legs: int = 60) -> Drive:
    """Return a drive of straight legs, bends, turns on the spot and stops in random order."""
    random = Random(seed)
    drive = [Leg(2.0, 0.0, 0.0)]
    for _ in range(legs):
        kind = random.choice(("stop", "straight", "straight", "bend", "bend", "turn"))
        velocity = random.choice((-0.4, 0.3, 0.5, 0.7)) if kind in ("straight", "bend") else 0.0
        widest = {"bend": 0.9, "turn": 1.4}.get(kind, 0.0)
        drive.append(Leg(random.uniform(1.5, 4.0), velocity, random.uniform(-widest, widest)))
    return Drive(drive)


def simulate(
    drive: Drive,
    duration: float,
    seed: int,
    soc: Optional[float] = None,
    world: World = AS_FITTED,
    then: Optional[Tuple[float, World]] = None,
) -> Dataset:
    """Record `duration` s of `drive` on the simulated rover with `seed`.

    `soc` (0 to 1) is the state of charge at its beginning; without it, it is the world's. `then`:
    so many s after the beginning the world becomes another one.
    """
    rover, odometry, sensor = Rover(seed, soc, world), Odometry(), CurrentSensor()
    names = [field.name for field in fields(Truth)]
    values = attrgetter(*names)
    measured: List[Tuple[float, ...]] = []
    truth: List[Tuple[float, ...]] = []
    time = np.arange(int(duration / PERIOD_S)) * PERIOD_S
    velocity, turn_rate = 0.0, 0.0
    for row, now in enumerate(time):
        if then is not None and row == round(then[0] / PERIOD_S):
            rover.enter(then[1])
        if row % COMMAND_ROWS == 0:
            velocity, turn_rate = drive.command(float(now))
            rover.command(velocity, turn_rate)
        for _ in range(STEPS):
            rover.step(PERIOD_S / STEPS)
        reading = rover.measure()
        odometry.update(float(now), reading.wheel_velocity, reading.wheel_turn_rate)
        truth.append(values(rover.truth()))
        measured.append(
            (
                sensor.amperes(reading.current_counts),
                reading.battery_voltage,
                odometry.velocity,
                odometry.turn_rate,
                odometry.acceleration,
                odometry.turn_acceleration,
                reading.gyroscope,
                reading.accelerometer,
                velocity,
                turn_rate,
            )
        )
    paths = [CURRENT, VOLTAGE, VELOCITY, TURN_RATE, ACCELERATION, TURN_ACCELERATION]
    paths += [GYROSCOPE, ACCELEROMETER, COMMANDED_VELOCITY, COMMANDED_TURN_RATE]
    columns = dict(zip(paths, np.array(measured).T))
    columns[STATE_OF_CHARGE] = _counted(columns[CURRENT], columns[VOLTAGE])
    true = dict(zip(names, np.array(truth).T))
    true["commanded_velocity"] = columns[COMMANDED_VELOCITY]
    true["commanded_turn_rate"] = columns[COMMANDED_TURN_RATE]
    return Dataset(time, columns, true)


def _counted(current: np.ndarray, voltage: np.ndarray) -> np.ndarray:
    """Count the state of charge from that of the first second: every drive begins at rest."""
    battery = BatteryParameters()
    charges, voltages = np.array(battery.open_circuit).T
    source = np.mean(voltage[:START_ROWS]) + battery.resting_resistance * np.mean(
        current[:START_ROWS]
    )
    used = np.cumsum(current) * PERIOD_S / 3600.0 / battery.capacity
    return np.interp(source, voltages, charges) - used

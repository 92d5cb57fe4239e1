"""The simulated rover: motion, power, battery and sensors, with the time step passed in."""
import math
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Callable, Optional

from shsa_rover.battery import Battery
from shsa_rover.chassis import GRAVITY, Chassis
from shsa_rover.ground import Ground
from shsa_rover.motors import greatest_force, motor_power
from shsa_rover.paper_battery import PaperBattery
from shsa_rover.sensors import TRACK, Readings, quantised
from shsa_rover.voltage_sensor import VoltageSensor
from shsa_rover.worlds import AS_FITTED, World


@dataclass(frozen=True)
class Truth:
    """The rover's state without any sensor in between; SI units, `state_of_charge` from 0 to 1.

    `specific_force` is what an accelerometer along the rover feels: its acceleration, and what
    holds it up on a slope. `drive_power` is what the wheels do on the ground, `slope` (rad) is
    positive uphill.
    """

    battery_current: float
    battery_voltage: float
    battery_power: float
    state_of_charge: float
    linear_velocity: float
    linear_acceleration: float
    specific_force: float
    angular_velocity: float
    angular_acceleration: float
    left_wheel_velocity: float
    right_wheel_velocity: float
    drive_power: float
    slope: float


class Rover:
    """A rover at rest with its electronics on, in a `world`.

    `soc` is its state of charge, 0 to 1; without it, it is the world's. The same `seed`, world,
    commands and steps give the same run.
    """

    def __init__(
        self, seed: int = 0, soc: Optional[float] = None, world: World = AS_FITTED
    ) -> None:
        soc = world.state_of_charge if soc is None else soc
        self.chassis = Chassis(world.chassis)
        self.battery = _battery(world, soc, self.chassis)
        self.power = world.motors.electronics
        self._seed, self._world = seed, world
        self._ground = Ground(math.radians(world.slope), seed)
        self._distance = 0.0
        self._floor_noise = Random(f"{seed}/floor")
        self._sensor_noise = Random(f"{seed}/sensors")

    def enter(self, world: World) -> None:
        """Go on in another world: with its load, on its ground, with its battery and sensors."""
        self._world = world
        self.chassis.parameters = world.chassis
        self.battery.parameters = world.battery
        self._ground = Ground(math.radians(world.slope), self._seed)

    def command(self, velocity: float, turn_rate: float) -> None:
        """The wanted velocity (m/s) and turn rate (rad/s)."""
        self.chassis.command(velocity, turn_rate)

    def step(self, dt: float) -> None:
        """Moves on by `dt` seconds, about 0.01."""
        motors = self._world.motors
        greatest: Optional[Callable[[float], float]] = None
        if motors.limited_by_voltage:
            greatest = partial(greatest_force, voltage=self.battery.voltage, parameters=motors)
        self._distance += self.chassis.forward.velocity * dt
        slope = self._ground.slope(self._distance)
        self.chassis.step(dt, self._floor_noise.gauss(0.0, 1.0), slope, greatest)
        left, right = self.chassis.efforts()
        self.power = motors.electronics + motor_power(left, motors) + motor_power(right, motors)
        self.battery.draw(self.power, dt)

    def truth(self) -> Truth:
        """Return the state as it is."""
        chassis, battery = self.chassis, self.battery
        left, right = chassis.efforts()
        return Truth(
            battery_current=battery.current,
            battery_voltage=battery.voltage,
            battery_power=self.power,
            state_of_charge=battery.soc,
            linear_velocity=chassis.forward.velocity,
            linear_acceleration=chassis.forward.acceleration,
            specific_force=self._specific_force(),
            angular_velocity=chassis.turn.velocity,
            angular_acceleration=chassis.turn.acceleration,
            left_wheel_velocity=left.speed,
            right_wheel_velocity=right.speed,
            drive_power=left.force * left.speed + right.force * right.speed,
            slope=chassis.slope,
        )

    def measure(self) -> Readings:
        """Return a reading of every sensor, with its noise, gain, offset and steps."""
        s, gauss = self._world.sensors, self._sensor_noise.gauss
        chassis, battery = self.chassis, self.battery
        left, right = chassis.wheel_speeds()
        voltage = s.voltage_gain * battery.voltage + s.voltage_offset
        turn_rate = (right - left) / chassis.parameters.track
        current_counts = self._world.current_sensor.counts(
            battery.current + gauss(0.0, s.current_noise)
        )
        voltage_counts = VoltageSensor().counts(voltage + gauss(0.0, s.voltage_noise))
        velocity = s.velocity_gain * 0.5 * (left + right) + gauss(0.0, s.velocity_noise)
        turning = 0.5 * TRACK * (s.velocity_gain * turn_rate + gauss(0.0, s.turn_rate_noise))
        return Readings(
            current_counts=current_counts,
            voltage_counts=voltage_counts,
            left_speed=quantised(velocity - turning, s.speed_step),
            right_speed=quantised(velocity + turning, s.speed_step),
            gyroscope=s.gyroscope_gain * chassis.turn.velocity
            + s.gyroscope_offset
            + gauss(0.0, s.gyroscope_noise),
            accelerometer=s.accelerometer_gain * self._specific_force()
            + s.accelerometer_offset
            + gauss(0.0, s.accelerometer_noise),
        )

    def _specific_force(self) -> float:
        """Return what an accelerometer along the rover feels, m/s**2, the support included."""
        return self.chassis.forward.acceleration + GRAVITY * math.sin(self.chassis.slope)


def _battery(world: World, soc: float, chassis: Chassis) -> Battery:
    """Return the battery of a rover at rest, which has long supplied its electronics."""
    if world.follows_f1:
        return PaperBattery(soc, chassis)
    resting = Battery(soc, parameters=world.battery)
    resting_current = world.motors.electronics / resting.open_circuit_voltage
    return Battery(soc, resting_current, world.battery)

"""The simulated rover: motion, power, battery and sensors, with the time step passed in."""
from dataclasses import dataclass
from random import Random

from shsa_rover.battery import Battery, BatteryParameters
from shsa_rover.chassis import Chassis, ChassisParameters
from shsa_rover.current_sensor import CurrentSensor
from shsa_rover.motors import PowerParameters, motor_power


@dataclass(frozen=True)
class SensorParameters:
    """Noise (standard deviations), offsets and smallest steps of the sensors.

    Current: 7 mV peak to peak (ACS712 x30A data sheet), i.e. about 1.1 mV or 16 mA. Velocity: 1
    mm/s steps as in the robot's serial packets. The rest are estimates: voltage by a 10-bit ADC
    over 16.5 V; a MEMS gyroscope and accelerometer on a vibrating robot.
    """

    current_noise: float = 0.016  # A
    voltage_noise: float = 0.010  # V
    voltage_step: float = 16.5 / 1024  # V
    velocity_noise: float = 0.0008  # m/s
    velocity_step: float = 0.001  # m/s
    turn_rate_noise: float = 0.004  # rad/s, from the wheels
    gyroscope_noise: float = 0.02  # rad/s
    gyroscope_offset: float = 0.002  # rad/s
    accelerometer_noise: float = 0.05  # m/s^2
    accelerometer_offset: float = 0.02  # m/s^2


@dataclass(frozen=True)
class Truth:
    """The rover's state without any sensor in between; SI units, `state_of_charge` from 0 to 1.

    `drive_power` is what the wheels do on the ground.
    """

    battery_current: float
    battery_voltage: float
    battery_power: float
    state_of_charge: float
    linear_velocity: float
    linear_acceleration: float
    angular_velocity: float
    angular_acceleration: float
    left_wheel_velocity: float
    right_wheel_velocity: float
    drive_power: float


@dataclass(frozen=True)
class Readings:
    """What the sensors say: ADC counts of the current, and SI units for the rest."""

    current_counts: int
    battery_voltage: float
    wheel_velocity: float
    wheel_turn_rate: float
    gyroscope: float
    accelerometer: float


class Rover:
    """A rover at rest with its electronics on.

    The same `seed`, commands and steps give the same run.
    """

    def __init__(
        self,
        seed: int = 0,
        soc: float = 0.8,
        chassis: ChassisParameters = ChassisParameters(),
        power: PowerParameters = PowerParameters(),
        battery: BatteryParameters = BatteryParameters(),
        sensors: SensorParameters = SensorParameters(),
        current_sensor: CurrentSensor = CurrentSensor(),
    ) -> None:
        self.chassis = Chassis(chassis)
        resting = Battery(soc, parameters=battery)
        resting_current = power.electronics / resting.open_circuit_voltage
        self.battery = Battery(soc, resting_current, battery)
        self.power = power.electronics
        self._power = power
        self._sensors = sensors
        self._current_sensor = current_sensor
        self._floor_noise = Random(f"{seed}/floor")
        self._sensor_noise = Random(f"{seed}/sensors")

    def command(self, velocity: float, turn_rate: float) -> None:
        """The wanted velocity (m/s) and turn rate (rad/s)."""
        self.chassis.command(velocity, turn_rate)

    def step(self, dt: float) -> None:
        """Moves on by `dt` seconds, about 0.01."""
        self.chassis.step(dt, self._floor_noise.gauss(0.0, 1.0))
        left, right = self.chassis.efforts()
        self.power = (
            self._power.electronics
            + motor_power(left, self._power)
            + motor_power(right, self._power)
        )
        self.battery.draw(self.power, dt)

    def truth(self) -> Truth:
        """The state as it is."""
        chassis, battery = self.chassis, self.battery
        left, right = chassis.efforts()
        return Truth(
            battery_current=battery.current,
            battery_voltage=battery.voltage,
            battery_power=self.power,
            state_of_charge=battery.soc,
            linear_velocity=chassis.forward.velocity,
            linear_acceleration=chassis.forward.acceleration,
            angular_velocity=chassis.turn.velocity,
            angular_acceleration=chassis.turn.acceleration,
            left_wheel_velocity=left.speed,
            right_wheel_velocity=right.speed,
            drive_power=left.force * left.speed + right.force * right.speed,
        )

    def measure(self) -> Readings:
        """A reading of every sensor, with its noise, offset and steps."""
        s, truth, gauss = self._sensors, self.truth(), self._sensor_noise.gauss
        return Readings(
            current_counts=self._current_sensor.counts(
                truth.battery_current + gauss(0.0, s.current_noise)
            ),
            battery_voltage=quantised(
                truth.battery_voltage + gauss(0.0, s.voltage_noise), s.voltage_step
            ),
            wheel_velocity=quantised(
                truth.linear_velocity + gauss(0.0, s.velocity_noise), s.velocity_step
            ),
            wheel_turn_rate=truth.angular_velocity + gauss(0.0, s.turn_rate_noise),
            gyroscope=truth.angular_velocity + s.gyroscope_offset + gauss(0.0, s.gyroscope_noise),
            accelerometer=truth.linear_acceleration
            + s.accelerometer_offset
            + gauss(0.0, s.accelerometer_noise),
        )


def quantised(value: float, step: float) -> float:
    """`value` rounded to whole steps."""
    return round(value / step) * step

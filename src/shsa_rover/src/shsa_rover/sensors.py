"""Sensors of the rover: noise, gains, offsets and steps."""
from dataclasses import dataclass

from shsa_rover.chassis import ChassisParameters
from shsa_rover.voltage_sensor import VoltageSensor

TRACK = ChassisParameters.track  # m, by which the wheels' speeds tell a turn rate


@dataclass(frozen=True)
class SensorParameters:
    """Noise (standard deviations), gains, offsets and smallest steps of the sensors.

    Current: 7 mV peak to peak (ACS712 x30A data sheet), i.e. about 1.1 mV or 16 mA; its gain and
    offset are in `CurrentSensor`. Speeds of the wheels: 1 mm/s steps, as in the robot's serial
    packets. The rest are estimates, of a MEMS gyroscope and accelerometer on a vibrating robot.
    """

    current_noise: float = 0.016  # A
    voltage_noise: float = 0.010  # V
    voltage_gain: float = 1.0
    voltage_offset: float = 0.0  # V
    velocity_noise: float = 0.0008  # m/s
    speed_step: float = 0.001  # m/s, of each side
    velocity_gain: float = 1.0  # of both sides: the tyres' real circumference is another
    turn_rate_noise: float = 0.004  # rad/s, from the wheels
    gyroscope_noise: float = 0.02  # rad/s
    gyroscope_gain: float = 1.0
    gyroscope_offset: float = 0.002  # rad/s
    accelerometer_noise: float = 0.05  # m/s^2
    accelerometer_gain: float = 1.0
    accelerometer_offset: float = 0.02  # m/s^2

    @property
    def velocity_variance(self) -> float:
        """m^2/s^2: noise, and the steps of both sides."""
        return self.velocity_noise**2 + 0.5 * quantisation_variance(self.speed_step)

    @property
    def turn_rate_variance(self) -> float:
        """rad^2/s^2, from the wheels: noise, and the steps of both sides."""
        return self.turn_rate_noise**2 + 2.0 * quantisation_variance(self.speed_step / TRACK)

    @property
    def voltage_variance(self) -> float:
        """V^2: noise and steps."""
        return self.voltage_noise**2 + quantisation_variance(VoltageSensor().resolution)

    @property
    def gyroscope_variance(self) -> float:
        """rad^2/s^2: noise and offset."""
        return self.gyroscope_noise**2 + self.gyroscope_offset**2

    @property
    def accelerometer_variance(self) -> float:
        """m^2/s^4: noise and offset."""
        return self.accelerometer_noise**2 + self.accelerometer_offset**2


@dataclass(frozen=True)
class Readings:
    """Readings of the sensors: ADC counts of current and voltage, and SI units for the rest.

    `left_speed` and `right_speed` are those of the wheels.
    """

    current_counts: int
    voltage_counts: int
    left_speed: float
    right_speed: float
    gyroscope: float
    accelerometer: float

    @property
    def battery_voltage(self) -> float:
        """V."""
        return VoltageSensor().volts(self.voltage_counts)

    @property
    def wheel_velocity(self) -> float:
        """m/s."""
        return 0.5 * (self.left_speed + self.right_speed)

    @property
    def wheel_turn_rate(self) -> float:
        """rad/s."""
        return (self.right_speed - self.left_speed) / TRACK


def quantisation_variance(step: float) -> float:
    """Return the variance of rounding to whole steps: the error is uniform within one."""
    return step**2 / 12.0


def quantised(value: float, step: float) -> float:
    """`value` rounded to whole steps."""
    return round(value / step) * step

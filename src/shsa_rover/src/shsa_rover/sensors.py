"""Sensors of the rover: noise, gains, offsets and steps."""
from dataclasses import dataclass


@dataclass(frozen=True)
class SensorParameters:
    """Noise (standard deviations), gains, offsets and smallest steps of the sensors.

    Current: 7 mV peak to peak (ACS712 x30A data sheet), i.e. about 1.1 mV or 16 mA; its gain and
    offset are in `CurrentSensor`. Velocity: 1 mm/s steps as in the robot's serial packets. The rest
    are estimates: voltage by a 10-bit ADC over 16.5 V; a MEMS gyroscope and accelerometer on a
    vibrating robot.
    """

    current_noise: float = 0.016  # A
    voltage_noise: float = 0.010  # V
    voltage_step: float = 16.5 / 1024  # V
    voltage_gain: float = 1.0
    voltage_offset: float = 0.0  # V
    velocity_noise: float = 0.0008  # m/s
    velocity_step: float = 0.001  # m/s
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
        """m^2/s^2: noise and steps."""
        return self.velocity_noise**2 + quantisation_variance(self.velocity_step)

    @property
    def voltage_variance(self) -> float:
        """V^2: noise and steps."""
        return self.voltage_noise**2 + quantisation_variance(self.voltage_step)

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
    """Readings of the sensors: ADC counts of the current, and SI units for the rest."""

    current_counts: int
    battery_voltage: float
    wheel_velocity: float
    wheel_turn_rate: float
    gyroscope: float
    accelerometer: float


def quantisation_variance(step: float) -> float:
    """Return the variance of rounding to whole steps: the error is uniform within one."""
    return step**2 / 12.0


def quantised(value: float, step: float) -> float:
    """`value` rounded to whole steps."""
    return round(value / step) * step

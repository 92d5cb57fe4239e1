"""Power of motors and electronics, and the limits of the motors."""
from dataclasses import dataclass

from shsa_rover.chassis import Effort


@dataclass(frozen=True)
class PowerParameters:
    """Four brushed 12 V gear motors, the size of a Pittman GM9236, gears of about 50:1.

    Estimates throughout.

    `electronics`: motor controller and sonars 6 W, onboard computer 19 W, Raspberry Pi and sensors
    5 W. `force_per_ampere` is without the gears' losses; the same figure, in V s/m, is the back EMF
    by the wheels' speed, as in any permanent-magnet motor.
    """

    electronics: float = 30.0  # W
    gear_efficiency: float = 0.6
    force_per_ampere: float = 12.4  # N/A at the wheels of one side, both motors together
    armature_resistance: float = 0.36  # Ohm, one side's two motors in parallel
    gears_load_windings: bool = False  # the windings carry the torque that the gears lose, too
    limited_by_voltage: bool = False  # no motion beyond back EMF + I*R = U


def motor_current(effort: Effort, parameters: PowerParameters) -> float:
    """Return the current (A) of one side's motors, in the direction of the force."""
    p = parameters
    if not p.gears_load_windings:
        return effort.force / p.force_per_ampere
    driving = effort.force * effort.speed > 0.0
    through = 1.0 / p.gear_efficiency if driving else p.gear_efficiency
    return effort.force * through / p.force_per_ampere


def motor_power(effort: Effort, parameters: PowerParameters) -> float:
    """Return the electrical power (W) of one side's motors: work, gears and copper losses.

    Braking heats gears and windings; nothing flows back into the battery.
    """
    p = parameters
    work = effort.force * effort.speed
    shaft = work / p.gear_efficiency if work > 0.0 else work * p.gear_efficiency
    copper = p.armature_resistance * motor_current(effort, p) ** 2
    return max(0.0, shaft + copper)


def greatest_force(speed: float, voltage: float, parameters: PowerParameters) -> float:
    """Return the greatest force (N) by which one side's motors can drive on at `speed` (m/s).

    `voltage` (V) is the battery's. It leaves back EMF + I*R = U; beyond the no-load speed it is 0.
    """
    p = parameters
    left = max(0.0, voltage - p.force_per_ampere * abs(speed))
    passed = p.gear_efficiency if p.gears_load_windings else 1.0
    return left / p.armature_resistance * p.force_per_ampere * passed

"""What the motors and the electronics take from the battery."""
from dataclasses import dataclass

from shsa_rover.chassis import Effort


@dataclass(frozen=True)
class PowerParameters:
    """Four brushed 12 V gear motors, the size of a Pittman GM9236, gears of about 50:1.

    Estimates throughout.

    `electronics`: motor controller and sonars 6 W, onboard computer 19 W, Raspberry Pi and sensors
    5 W.
    """

    electronics: float = 30.0  # W
    gear_efficiency: float = 0.6
    force_per_ampere: float = 12.4  # N/A at the wheels of one side, both motors together
    armature_resistance: float = 0.36  # Ohm, one side's two motors in parallel


def motor_power(effort: Effort, parameters: PowerParameters) -> float:
    """The electrical power (W) of one side's motors: work through the gears, and copper losses.

    Braking heats gears and windings; nothing flows back into the battery.
    """
    p = parameters
    work = effort.force * effort.speed
    shaft = work / p.gear_efficiency if work > 0.0 else work * p.gear_efficiency
    copper = p.armature_resistance * (effort.force / p.force_per_ampere) ** 2
    return max(0.0, shaft + copper)

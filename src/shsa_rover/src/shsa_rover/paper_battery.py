"""The battery of the paper's rover, as far as its relation f1 tells of it (Section V-A3)."""
from shsa_rover.battery import Battery, BatteryParameters
from shsa_rover.chassis import Chassis

BY_NOTHING, BY_VOLTAGE = 48.67, 3.72  # A, A/V
BY_VELOCITY, BY_ACCELERATION = -0.03, -1.17  # A s/m, A s^2/m
BY_TURN_RATE, BY_TURN_ACCELERATION = 2.07, -0.03  # A s/rad, A s^2/rad
PAPER_BATTERY = BatteryParameters(resistance=1.0 / BY_VOLTAGE, polarisation_resistance=0.0)


class PaperBattery(Battery):
    """A battery whose current is f1 of its voltage and of the motion of a chassis, at any moment.

    f1 is linear in the voltage: its slope is an internal resistance, the rest is a source. f1
    knows no state of charge, so the voltage does not fall while the battery empties.
    """

    def __init__(self, soc: float, chassis: Chassis) -> None:
        super().__init__(soc, parameters=PAPER_BATTERY)
        self._chassis = chassis

    @property
    def open_circuit_voltage(self) -> float:
        """V at which f1 tells no current, in the present motion."""
        forward, turn = self._chassis.forward, self._chassis.turn
        current = (
            BY_NOTHING
            + BY_VELOCITY * abs(forward.velocity)
            + BY_ACCELERATION * abs(forward.acceleration)
            + BY_TURN_RATE * abs(turn.velocity)
            + BY_TURN_ACCELERATION * abs(turn.acceleration)
        )
        return current / BY_VOLTAGE

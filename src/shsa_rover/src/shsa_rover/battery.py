"""A lead-acid battery: state of charge, open-circuit voltage, and sag under load."""
import math
from dataclasses import dataclass
from typing import Tuple


@dataclass(frozen=True)
class BatteryParameters:
    """Three 12 V, 7.2 Ah sealed lead-acid batteries in parallel (Pioneer 3-AT data sheet).

    `open_circuit`: (state of charge, V) for AGM batteries at rest, a common rule of thumb
    (estimate). `resistance`: three times 25 mOhm in parallel (usual data-sheet figure of a 12 V, 7
    Ah AGM battery) and 27 mOhm for wires, fuse and contacts (estimate). `polarisation_*`: the slow
    part of the sag (estimate). Temperature, ageing and the loss of capacity at high currents
    (Peukert) are not modelled: the rover draws about C/4.
    """

    capacity: float = 21.6  # Ah
    open_circuit: Tuple[Tuple[float, float], ...] = (
        (0.0, 11.80),
        (0.25, 12.00),
        (0.5, 12.30),
        (0.75, 12.60),
        (1.0, 12.85),
    )
    resistance: float = 0.035  # Ohm
    polarisation_resistance: float = 0.020  # Ohm
    polarisation_time: float = 20.0  # s

    @property
    def resting_resistance(self) -> float:
        """Ohm: the whole sag per ampere once a constant current has flowed for long."""
        return self.resistance + self.polarisation_resistance


class Battery:
    """A battery that has long been supplying `resting_current` (A).

    `soc` is its state of charge, 0 to 1.
    """

    def __init__(
        self,
        soc: float,
        resting_current: float = 0.0,
        parameters: BatteryParameters = BatteryParameters(),
    ) -> None:
        self.parameters = parameters
        self.soc = soc
        self.current = resting_current
        self._polarisation = resting_current * parameters.polarisation_resistance

    @property
    def open_circuit_voltage(self) -> float:
        """V, by linear interpolation of the table."""
        points = self.parameters.open_circuit
        for (low, low_volts), (high, high_volts) in zip(points, points[1:]):
            if self.soc <= high:
                break
        return low_volts + (high_volts - low_volts) * (self.soc - low) / (high - low)

    @property
    def voltage(self) -> float:
        """V at the terminals, under the present current."""
        return (
            self.open_circuit_voltage
            - self._polarisation
            - self.parameters.resistance * self.current
        )

    def draw(self, power: float, dt: float) -> None:
        """Supplies `power` (W) for `dt` seconds.

        A flat battery still supplies, at its lowest voltage.

        The current solves power = (E - R*I)*I for the smaller I; beyond the greatest power, E^2/4R,
        it stays there.
        """
        p = self.parameters
        source = self.open_circuit_voltage - self._polarisation
        root = math.sqrt(max(0.0, source * source - 4.0 * p.resistance * power))
        self.current = (source - root) / (2.0 * p.resistance)
        self.soc = min(1.0, max(0.0, self.soc - self.current * dt / 3600.0 / p.capacity))
        settled = self.current * p.polarisation_resistance
        decay = math.exp(-dt / p.polarisation_time)
        self._polarisation = settled + (self._polarisation - settled) * decay

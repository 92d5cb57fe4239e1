"""The battery current's sensor: ADC counts to amperes and back."""
from dataclasses import dataclass


@dataclass(frozen=True)
class CurrentSensor:
    """A Hall-effect sensor on a microcontroller's ADC.

    The current is positive while the battery discharges.

    Values of the Allegro ACS712ELCTR-30A (data sheet, x30A performance characteristics): 66 mV/A,
    half the 5 V supply at 0 A; read with the 10-bit ADC of a 5 V microcontroller.
    """

    sensitivity: float = 0.066  # V/A
    zero: float = 2.5  # V at 0 A
    reference: float = 5.0  # V at full scale
    levels: int = 1024

    @property
    def resolution(self) -> float:
        """Amperes per count."""
        return self.reference / self.levels / self.sensitivity

    def counts(self, current: float) -> int:
        """Return the ADC's counts at `current` (A): whole, saturating at its ends."""
        volts = self.zero + self.sensitivity * current
        return min(self.levels - 1, max(0, round(volts / self.reference * self.levels)))

    def amperes(self, counts: int) -> float:
        """Return the current (A) that `counts` stand for."""
        return (counts * self.reference / self.levels - self.zero) / self.sensitivity

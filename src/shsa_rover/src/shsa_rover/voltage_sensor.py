"""The battery voltage's sensor: ADC counts to volts and back."""
from dataclasses import dataclass


@dataclass(frozen=True)
class VoltageSensor:
    """A divider before the same 10-bit ADC as the current's."""

    full_scale: float = 16.5  # V (estimate)
    levels: int = 1024

    @property
    def resolution(self) -> float:
        """Volts per count."""
        return self.full_scale / self.levels

    def counts(self, voltage: float) -> int:
        """Return the ADC's counts at `voltage` (V): whole, saturating at its ends."""
        return min(self.levels - 1, max(0, round(voltage / self.resolution)))

    def volts(self, counts: int) -> float:
        """Return the voltage (V) that `counts` stand for."""
        return counts * self.resolution

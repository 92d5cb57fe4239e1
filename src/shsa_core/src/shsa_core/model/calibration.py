"""A substitute's calibration: the gain and offset by which its value is that of the lost sensor."""
from dataclasses import dataclass
from typing import Optional, Tuple

from shsa_core.model.error import Error
from shsa_core.model.substitution import Program


@dataclass(frozen=True)
class Calibration:
    """A substitute publishes `gain` * derived + `offset`; `error`: what that erred by lately.

    The offset is in the unit of the property. None: the error is not known.
    """

    gain: float = 1.0
    offset: float = 0.0
    error: Optional[Error] = None

    def __call__(self, derived: float) -> float:
        """Return the calibrated value."""
        return self.gain * derived + self.offset


UNCALIBRATED = Calibration()


@dataclass(frozen=True)
class CalibrationRow:
    """The calibration of a program that would substitute a service, output by output."""

    service: str
    program: Program
    calibrations: Tuple[Calibration, ...]


@dataclass(frozen=True)
class CalibrationsChanged:
    """New and changed calibrations, and those that are followed no more."""

    rows: Tuple[CalibrationRow, ...]
    removed: Tuple[Tuple[str, Program], ...] = ()

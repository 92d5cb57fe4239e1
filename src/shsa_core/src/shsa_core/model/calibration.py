"""A substitute's calibration: the gain and offset by which its value is that of the lost sensor.

And how its error grows once nobody measures that value any more.
"""
from dataclasses import dataclass, replace
from math import exp, inf, sqrt
from typing import Optional, Tuple

from shsa_core.model.error import P95, Error
from shsa_core.model.substitution import Program

PRIOR_GAIN = 0.3
"""The standard deviation of a relation's gain from 1 that is expected."""
PARTED = 1.5
"""Two derivations part once the mean square of their difference is so many times the expected."""


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


class Growth:
    """The growth of one value's error.

    It may be wrong where another derivation parts from it by more than their errors, and where it
    is beyond what was seen. What lasts for `rises` s is believed, and forgotten in `falls` s.
    """

    def __init__(self, rises: float, falls: float) -> None:
        self._rises, self._falls = rises, falls
        self._looked = inf
        self._square: Optional[float] = None  # of the difference, lately
        self._variance = 0.0

    def look(self, time: float, beyond: float, apart: Optional[Tuple[float, float]]) -> None:
        """Look at a value that is `beyond` what was seen, by so much in variance.

        `apart`: its difference from another one, and the square that is expected; None: unknown.
        """
        passed = max(0.0, time - self._looked)
        self._looked, found = time, beyond
        if apart is not None:
            difference, expected = apart
            before = expected if self._square is None else self._square
            square = before + (1.0 - exp(-passed / self._rises)) * (difference**2 - before)
            found += square - expected if square > PARTED * expected else 0.0
            self._square = square
        self._variance = max(found, self._variance * exp(-passed / self._falls))

    def added(self, error: Error, aged: float) -> Error:
        """Return an error with this, and with what age adds to its variance."""
        more = aged + self._variance
        p95 = sqrt(error.within**2 + P95**2 * more)
        return replace(error, rms=sqrt(error.rms**2 + more), p95=p95)

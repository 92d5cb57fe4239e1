"""How each program that may substitute a service is calibrated, as the monitor told last.

While a service is being healed its calibrations stay as they were at the failure.
"""
from typing import Callable, Dict, Sequence, Tuple

from shsa_core.codegen.generator import Program
from shsa_core.model.calibration import UNCALIBRATED, Calibration
from shsa_core.model.service import Signal
from shsa_core.monitoring.events import CalibrationRow

ENOUGH = 60
"""A monitor that starts anew knows less than the one before until it has seen so many samples."""

Calibrated = Tuple[Calibration, ...]


class Calibrations:
    """The newest calibration of every program; `open_` says whether a service is being healed."""

    def __init__(self, open_: Callable[[str], bool]) -> None:
        self._open = open_
        self._known: Dict[str, Dict[Program, Calibrated]] = {}
        self._later: Dict[str, Dict[Program, Calibrated]] = {}

    def of(self, service: str, program: Program) -> Calibrated:
        """The calibration of each output of a program; empty: none is known."""
        return self._known.get(service, {}).get(program, ())

    def take(self, row: CalibrationRow) -> bool:
        """Note what the monitor tells; whether it counts at once."""
        if len(row.calibrations) != len(row.program.outputs):
            return False
        known = self._known.get(row.service, {}).get(row.program, ())
        if _samples(row.calibrations) < min(ENOUGH, _samples(known)):
            return False
        now = not self._open(row.service)
        table = self._known if now else self._later
        table.setdefault(row.service, {})[row.program] = row.calibrations
        return now

    def leave(self, service: str, program: Program) -> None:
        """The monitor follows a program no more."""
        if not self._open(service):
            self._known.get(service, {}).pop(program, None)

    def recall(self, service: str, program: Program, outputs: Sequence[Signal]) -> None:
        """A former reconfigurator has calibrated a program so."""
        found = tuple(Calibration(each.gain, each.offset, each.error) for each in outputs)
        self._known.setdefault(service, {})[program] = found

    def healed(self, service: str) -> None:
        """A service is well again: what was told meanwhile counts."""
        self._known.setdefault(service, {}).update(self._later.pop(service, {}))

    def forget(self, service: str) -> None:
        """There is no such service any more."""
        self._known.pop(service, None)
        self._later.pop(service, None)


def _samples(calibrations: Calibrated) -> int:
    """How much is known at least of what is calibrated."""
    errors = (each.error for each in calibrations if each != UNCALIBRATED)
    return min((error.n or 0 for error in errors if error is not None), default=0)

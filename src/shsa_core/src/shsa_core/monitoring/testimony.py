"""What one derivation says of a measured value, and how far apart the two may be."""
from collections import deque
from dataclasses import dataclass, field
from math import isfinite
from typing import Deque, List, Optional, Tuple

from shsa_core.codegen.program import Step
from shsa_core.model.calibration import UNCALIBRATED, Calibration
from shsa_core.model.error import Error
from shsa_core.model.service import Source
from shsa_core.monitoring.calibration import Calibrator
from shsa_core.monitoring.gaps import LOOKS, Gap, spread

REMEMBERED = 60
"""Errors that were seen are remembered, one each LOOKS looks: for 2 minutes."""
ENOUGH = 60
"""So many samples, one a second, make an error known."""


@dataclass
class Testimony:
    """One derivation of a value: its inputs, and how far it is from what is measured.

    `stated`: how far it may be by the known errors, None: not known. `calibrator`: learns the gain
    and the offset that the sensor had while nobody doubted it, and what is left of the difference;
    None: what is derived counts as it is.
    """

    inputs: Tuple[Source, ...]
    step: Step
    stated: Optional[float]
    gap: Gap = field(default_factory=Gap)
    calibrator: Optional[Calibrator] = None
    calibration: Calibration = UNCALIBRATED
    raw: Optional[float] = None
    derived: Optional[float] = None
    _looks: int = 0
    _seen: Deque[Error] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    @property
    def allowed(self) -> Optional[float]:
        """How far it may be from what is measured: as stated, or as seen a while ago if less.

        What is seen now may be widened by what shall be found, a sensor that drifts.
        """
        seen = spread(self._seen[0]) if len(self._seen) == REMEMBERED else None
        known = [each for each in (self.stated, seen) if each is not None]
        return min(known, default=None)

    @property
    def nodes(self) -> Tuple[str, ...]:
        return tuple(dict.fromkeys(each.node for each in self.inputs))

    def say(self, known: List[Optional[float]], time: float) -> None:
        """Derive the value anew; None if an input is missing."""
        values = [each for each in known if each is not None]
        result = self.step(values, time) if len(values) == len(known) else None
        self.raw = result[0] if result is not None and isfinite(result[0]) else None
        self.derived = None if self.raw is None else self.calibration(self.raw)

    @property
    def judges(self) -> bool:
        """Whether it has looked for long enough to tell what is wrong."""
        known = self.calibrator is None or self.calibration.error is not None
        return known and self.gap.mean is not None

    def learn(self, measured: Optional[float], time: float, doubted: bool) -> None:
        """Learn of a measured value, unless something is doubted."""
        if self.calibrator is None:
            return
        if doubted or measured is None or self.raw is None:
            self.calibrator.doubt()
        else:
            self.calibrator.take(time, measured, self.raw)
        self._looks += 1
        if self._looks % LOOKS == 0:
            self.calibration = self.calibrator.snapshot()
            error = self.calibration.error
            if error is not None and (error.n or 0) >= ENOUGH:
                self._seen.append(error)

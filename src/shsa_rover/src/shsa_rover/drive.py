"""A scripted drive: what the rover is told, by time."""
import csv
import math
from dataclasses import dataclass
from typing import Iterable, List, Sequence, Tuple

from shsa_core.errors import ModelError


@dataclass(frozen=True)
class Leg:
    """For `duration` (s): drive at `velocity` (m/s) and `turn_rate` (rad/s)."""

    duration: float
    velocity: float
    turn_rate: float


SCRIPTED: Tuple[Leg, ...] = (
    Leg(3.0, 0.0, 0.0),
    Leg(3.0, 0.4, 0.0),
    Leg(3.0, 0.7, 0.0),
    Leg(2.0, 0.4, 0.8),
    Leg(2.0, 0.0, 1.2),
    Leg(2.0, 0.6, 0.0),
    Leg(1.5, 0.0, 0.0),
    Leg(2.5, -0.4, 0.0),
    Leg(2.0, 0.0, -1.2),
    Leg(3.0, 0.6, -0.5),
    Leg(2.0, 0.3, 0.0),
    Leg(2.0, 0.7, 0.4),
    Leg(2.0, 0.0, 0.0),
)


class Drive:
    """Legs one after the other.

    The script starts again after its end if `loop`, else the rover stands still.
    """

    def __init__(self, legs: Sequence[Leg] = SCRIPTED, loop: bool = True) -> None:
        self.legs = tuple(legs)
        self.loop = loop
        self.duration = sum(leg.duration for leg in self.legs)

    def command(self, time: float) -> Tuple[float, float]:
        """Velocity (m/s) and turn rate (rad/s) at `time` seconds from the start."""
        if self.loop:
            time = math.fmod(time, self.duration)
        for leg in self.legs:
            if time < leg.duration:
                return leg.velocity, leg.turn_rate
            time -= leg.duration
        return 0.0, 0.0


def parse_drive(lines: Iterable[str], where: str) -> List[Leg]:
    """Return the legs of a script: a line each, `duration (s), velocity (m/s), turn rate (rad/s)`.

    Empty lines and lines that start with # are skipped. Raises ModelError with file (`where`) and
    line.
    """
    legs: List[Leg] = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            cells = next(csv.reader([line]))
            duration, velocity, turn_rate = (float(cell) for cell in cells)
        except (ValueError, csv.Error):
            raise ModelError(
                f"{where}:{number}",
                f"'{line.strip()}' is not three numbers: duration (s), velocity (m/s), "
                "turn rate (rad/s)",
            ) from None
        if not all(map(math.isfinite, (duration, velocity, turn_rate))) or duration <= 0.0:
            raise ModelError(
                f"{where}:{number}", "numbers must be finite and the duration greater than 0"
            )
        legs.append(Leg(duration, velocity, turn_rate))
    if not legs:
        raise ModelError(
            where, "the script has no legs; a line each: duration, velocity, turn rate"
        )
    return legs

"""The ground under the rover: hills along its way."""
import math
from random import Random
from typing import List, Tuple

WAVES = ((0.6, 6.0, 12.0), (0.4, 3.0, 5.0))  # share of the steepest slope, lengths from, to (m)


class Ground:
    """Hills that are met by the distance driven; driving back meets them again.

    `steepest` (rad) is nowhere exceeded. The same `seed` gives the same hills. They are longer than
    the rover, so that all of its wheels stand on one slope (estimate).
    """

    def __init__(self, steepest: float, seed: int) -> None:
        random = Random(f"{seed}/hills")
        self._waves: List[Tuple[float, float, float]] = []
        if steepest:
            for share, shortest, longest in WAVES:
                number = math.tau / random.uniform(shortest, longest)
                self._waves.append((share * steepest, number, random.uniform(0.0, math.tau)))

    def slope(self, distance: float) -> float:
        """Return the slope (rad, positive uphill) at `distance` (m) along the way."""
        return sum(size * math.sin(n * distance + start) for size, n, start in self._waves)

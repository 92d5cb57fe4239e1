"""The rows that are learned from: the target, and what was known of each input at that moment"""
from dataclasses import dataclass
from typing import Dict, Mapping, Tuple

import numpy as np

MAX_ROWS = 3000
"""For fits: rows that lie nearer together tell much the same."""


@dataclass(frozen=True)
class Table:
    """Rows in the order of time.

    `name`: the target's; `time` in s, increasing, also from one recording to the next; `target` and
    each of `inputs` (by property) have a value a row, NaN where there is none; `period`: s between
    two rows that follow one another.
    """

    name: str
    time: np.ndarray
    target: np.ndarray
    inputs: Mapping[str, np.ndarray]
    period: float

    @property
    def names(self) -> Tuple[str, ...]:
        """The inputs' names, in order."""
        return tuple(self.inputs)

    @property
    def complete(self) -> np.ndarray:
        """Whether all of a row has a value, row by row."""
        known = np.isfinite(self.target)
        for column in self.inputs.values():
            known &= np.isfinite(column)
        return known

    @property
    def duration(self) -> float:
        """Seconds of complete rows."""
        return float(np.count_nonzero(self.complete) * self.period)

    def of(self, names: Tuple[str, ...]) -> "Table":
        """The table with these inputs alone."""
        kept: Dict[str, np.ndarray] = {name: self.inputs[name] for name in names}
        return Table(self.name, self.time, self.target, kept, self.period)

    def rows(self) -> np.ndarray:
        """The complete rows that fits look at, by number: MAX_ROWS at most, evenly spread."""
        complete = np.flatnonzero(self.complete)
        step = max(1, -(-len(complete) // MAX_ROWS))
        return complete[::step]

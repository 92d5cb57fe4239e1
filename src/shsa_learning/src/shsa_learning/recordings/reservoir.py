"""Keeps some of many rows: stretches of time, of each kind of excitation about as many"""
import sys
import zlib
from typing import Dict, List, Tuple

import numpy as np

MOST_ROWS, ALL_ROWS = 50_000, 1 << 40
NO_NUMBER = -sys.float_info.max
"""Stands for a value that says that there is no number, beside NaN for none."""
SLOT_S = 10.0
"""A stretch that is kept or left out as a whole: what remembers needs neighbours."""
FARTHEST, LARGEST = 2.0**62, 1e100
"""Numbers of stretches, and values, beyond which nothing is reckoned with them."""
LEVELS = 4
"""Levels of load, and of activity, that tell stretches apart."""

Cell = Tuple[int, int, int]


class Reservoir:
    """Rows of time (s, increasing) and values, as many as memory has room for.

    Where there are more than `most`, stretches of the commonest kind are left out first, and of
    these any. With `alone` False all stretches are of one kind: others then keep the same ones.
    """

    def __init__(self, columns: int, alone: bool, most: int = MOST_ROWS) -> None:
        self._alone, self._most = alone, most
        self.rows = 0
        self._kept = 0
        self._parts: List[np.ndarray] = []  # of the stretch that is not over
        self._slot = 0
        self._slots: Dict[int, np.ndarray] = {}
        self._cells: Dict[Cell, List[Tuple[int, int]]] = {}
        self._sums = np.zeros((3, columns))  # exact over all rows: counts, values, squares

    def add(self, rows: np.ndarray) -> None:
        """Add rows in the order of time: the time and the values, NaN where there is none."""
        values = rows[:, 1:]
        known = np.abs(values) < LARGEST
        values = np.where(known, values, 0.0)
        self._sums += [known.sum(axis=0), values.sum(axis=0), np.square(values).sum(axis=0)]
        self.rows += len(rows)
        slots = np.clip(np.floor(rows[:, 0] / SLOT_S), -FARTHEST, FARTHEST).astype(int)
        ends = [*np.flatnonzero(np.diff(slots)) + 1, len(rows)]
        begin = 0
        for end in ends:
            if slots[begin] != self._slot:
                self._close()
                self._slot = int(slots[begin])
            room = self._most - sum(map(len, self._parts))
            if room > 0:
                self._parts.append(rows[begin : min(end, begin + room)].copy())
            begin = end

    def table(self) -> np.ndarray:
        """Return the rows that are kept."""
        self._close()
        return np.concatenate([self._slots[slot] for slot in self._slots])

    def _close(self) -> None:
        if not self._parts:
            return
        rows = np.concatenate(self._parts)
        self._parts = []
        if self._slot in self._slots:  # the time went back a little
            rows = np.concatenate([self._slots[self._slot], rows])
            self._kept -= len(self._slots[self._slot])
        else:
            order = zlib.crc32(str(self._slot).encode()), self._slot
            self._cells.setdefault(self._cell(rows[:, 1:]), []).append(order)
        self._slots[self._slot] = rows
        self._kept += len(rows)
        while self._kept > self._most and len(self._slots) > 1:
            crowded = max(self._cells, key=lambda cell: len(self._cells[cell]))
            last = max(self._cells[crowded])
            self._cells[crowded].remove(last)
            self._kept -= len(self._slots.pop(last[1]))

    def _cell(self, values: np.ndarray) -> Cell:
        """Return the kind of a stretch: how far from usual, in which direction, how lively."""
        if not self._alone:
            return 0, 0, 0
        count, total, squares = self._sums
        count = np.maximum(count, 1.0)
        usual = total / count
        spread = np.sqrt(np.maximum(squares / count - np.square(usual), 0.0))
        spread = np.where(spread > 0.0, spread, 1.0)
        finite = np.where(np.abs(values) < LARGEST, values, usual)
        off = (finite.mean(axis=0) - usual) / spread
        lively = finite.std(axis=0) / spread
        most = int(np.argmax(np.abs(off)))
        load, activity = (min(int(2.0 * np.mean(x)), LEVELS) for x in (np.abs(off), lively))
        return load, activity, (most + 1) * (1 if off[most] >= 0.0 else -1)

"""Reads a CSV file: the first column is the time in s, each other one is named after a property."""
import csv
import math
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ModelError, listed
from shsa_core.files.regular import read_text
from shsa_core.language.syntax import is_name
from shsa_learning.recordings.recording import Series, ordered

TIME = "time"
FARTHEST_BACK_S = 1.0
"""A file whose time goes back by more holds several drives, or a clock that was set."""


def read_csv(path: str) -> Tuple[Tuple[Series, ...], Tuple[str, ...]]:
    """Read the series in a file, and what is to be said of them. An empty cell: no sample.

    Raises ModelError, with file and line, if it is no such file.
    """
    lines = csv.reader(read_text(path).lstrip("\ufeff").splitlines(), strict=True)
    columns: Optional[List[str]] = None
    times: List[float] = []
    newest = -math.inf
    rows: List[List[Optional[float]]] = []
    try:
        for cells in lines:
            where = f"{path}:{lines.line_num}"
            if not any(cell.strip() for cell in cells):
                continue
            if columns is None:
                columns = _columns(where, cells)
                continue
            time, row = _row(where, columns, cells)
            newest = max(newest, time)
            if time < newest - FARTHEST_BACK_S:
                raise ModelError(
                    where,
                    f"the time goes back from {newest:g} to {time:g} s; "
                    "a file holds one drive, in the order of time",
                )
            times.append(time)
            rows.append(row)
    except csv.Error as error:
        raise ModelError(f"{path}:{lines.line_num}", f"is not valid CSV: {error}") from error
    if columns is None or not rows:
        raise ModelError(path, "holds no samples: a line of column names, then one a sample")
    return _series(path, columns, np.array(times), rows)


def _columns(where: str, cells: Sequence[str]) -> List[str]:
    names = [cell.strip() for cell in cells]
    if names[0] != TIME:
        raise ModelError(where, f"the first column must be {TIME} (s), not {names[0]!a}")
    if len(names) < 2:
        raise ModelError(where, "there is no column beside the time; name one after its property")
    for place, name in enumerate(names):
        if not is_name(name):
            raise ModelError(
                where, f"{name!a} cannot be a property: a letter, then letters, digits and _"
            )
        if name in names[:place]:
            raise ModelError(where, f"the column {name} stands here a second time")
    return names[1:]


def _row(
    where: str, columns: Sequence[str], cells: Sequence[str]
) -> Tuple[float, List[Optional[float]]]:
    if len(cells) != len(columns) + 1:
        raise ModelError(where, f"{len(cells)} cells, but there are {len(columns) + 1} columns")
    time = _number(where, TIME, cells[0])
    if time is None or not math.isfinite(time):
        raise ModelError(where, f"{TIME} must be a finite number of s, not {cells[0]!a}")
    return time, [_number(where, name, cell) for name, cell in zip(columns, cells[1:])]


def _number(where: str, name: str, cell: str) -> Optional[float]:
    """Return the number in a cell; None if it is empty."""
    try:
        return float(cell) if cell.strip() else None
    except ValueError:
        raise ModelError(where, f"{name} must be a number or empty, not {cell[:40]!a}") from None


def _series(
    path: str, columns: Sequence[str], time: np.ndarray, rows: Sequence[Sequence[Optional[float]]]
) -> Tuple[Tuple[Series, ...], Tuple[str, ...]]:
    """Return a series for each column that has a sample."""
    series: List[Series] = []
    notes: Dict[str, None] = {}
    for place, name in enumerate(columns):
        there = [k for k, row in enumerate(rows) if row[place] is not None]
        if not there:
            notes[f"{path}: {name} has no sample"] = None
            continue
        order = ordered(time[there])
        values = np.array([rows[k][place] for k in there], dtype=float)
        notes.update({f"{path}: {note}": None for note in order.notes})
        series.append(Series(name, path, "", order.time, values[order.kept]))
    if not series:
        raise ModelError(path, f"holds no value of {listed(columns)}")
    return tuple(series), tuple(notes)

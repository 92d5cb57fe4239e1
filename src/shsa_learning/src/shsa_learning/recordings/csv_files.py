"""Reads a CSV file: the first column is the time in s, each other one is named after a property.

It is read in chunks, and of a large file some stretches are kept alone.
"""
import csv
import math
import warnings
from typing import BinaryIO, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ModelError, listed
from shsa_core.files.regular import open_to_read
from shsa_core.language.syntax import is_name
from shsa_learning.recordings.recording import Series, ordered
from shsa_learning.recordings.reservoir import MOST_ROWS, NO_NUMBER, Reservoir

TIME = "time"
FARTHEST_BACK_S = 1.0
"""A file whose time goes back by more holds several drives, or a clock that was set."""
CHUNK_BYTES = 1 << 22
LONGEST_LINE = 1 << 20
"""Bytes: what has longer lines is no such file."""
_PLAIN = b"0123456789eE+-., \n"

Step = Callable[[int], object]


class _Chunk(NamedTuple):
    """Some whole lines of a file, the first of which has the number `line`."""

    line: int
    raw: bytes


def read_csv(
    path: str, alone: bool = True, step: Step = lambda size: None, most: int = MOST_ROWS
) -> Tuple[Tuple[Series, ...], Tuple[str, ...]]:
    """Read the series in a file, and what is to be said of them. An empty cell: no sample.

    `alone`: no other file is of the same drive; of its rows `most` are kept. `step` is told of the
    bytes that are read. Raises ModelError, with file and line, if it is no such file.
    """
    columns: Optional[List[str]] = None
    newest = -math.inf
    kept: Optional[Reservoir] = None
    with open_to_read(path) as file:
        for chunk in _chunks(path, file):
            step(len(chunk.raw))
            if columns is None:
                columns, chunk = _header(path, chunk)
                if columns is None:
                    continue
                kept = Reservoir(len(columns), alone, most)
            rows = _plain_rows(chunk.raw, len(columns) + 1)
            if rows is None:
                rows = _any_rows(path, chunk, columns)
            if kept is not None and len(rows):
                newest = _checked_times(path, chunk, rows[:, 0], newest)
                kept.add(rows)
    if columns is None or kept is None or not kept.rows:
        raise ModelError(path, "holds no samples: a line of column names, then one a sample")
    table = kept.table()
    series, notes = _series(path, columns, table)
    if len(table) < kept.rows:
        notes += (f"{path}: {len(table)} of {kept.rows} rows are kept, of all kinds of stretches",)
    return series, notes


def _chunks(path: str, file: BinaryIO) -> Iterator[_Chunk]:
    """Yield a file in chunks of whole lines."""
    line, rest = 1, b""
    while True:
        try:
            raw = file.read(CHUNK_BYTES)
        except OSError as error:
            raise ModelError(path, f"cannot be read: {error.strerror}") from error
        if not raw:
            break
        whole, end, rest_of = (rest + raw).replace(b"\r\n", b"\n").rpartition(b"\n")
        rest = rest_of
        if len(rest) > LONGEST_LINE:
            raise ModelError(f"{path}:{line}", f"has more than {LONGEST_LINE} bytes in a line")
        if end:
            yield _Chunk(line, whole + end)
            line += whole.count(b"\n") + 1
    if rest:
        yield _Chunk(line, rest + b"\n")


def _text(path: str, chunk: _Chunk) -> str:
    try:
        text = chunk.raw.decode("utf-8")
        place, what = chunk.raw.find(b"\0"), "holds a zero byte; it is no text"
    except UnicodeDecodeError as error:
        place, what = error.start, "is not UTF-8 text"
    if place >= 0:
        raise ModelError(f"{path}:{chunk.line + chunk.raw[:place].count(10)}", what)
    return text.lstrip("\ufeff") if chunk.line == 1 else text


def _header(path: str, chunk: _Chunk) -> Tuple[Optional[List[str]], _Chunk]:
    """Return the columns, if a line of the chunk names them, and what follows that line."""
    raw, line = chunk.raw, chunk.line
    while raw:
        first, _, raw = raw.partition(b"\n")
        one = _Chunk(line, first + b"\n")
        line += 1
        for _, cells in _lines(path, one):
            return _columns(f"{path}:{one.line}", cells), _Chunk(line, raw)
    return None, chunk


def _lines(path: str, chunk: _Chunk) -> Iterator[Tuple[str, Sequence[str]]]:
    """Yield the cells of each line that has any, and where it is."""
    lines = csv.reader(_text(path, chunk).splitlines(), strict=True)
    try:
        for cells in lines:
            if any(cell.strip() for cell in cells):
                yield f"{path}:{chunk.line + lines.line_num - 1}", cells
    except csv.Error as error:
        where = f"{path}:{chunk.line + lines.line_num - 1}"
        raise ModelError(where, f"is not valid CSV: {error}") from error


def _plain_rows(raw: bytes, width: int) -> Optional[np.ndarray]:
    """Return the numbers of lines that hold plain numbers alone; None if they hold anything else.

    An empty cell is NaN.
    """
    if raw.translate(None, _PLAIN):
        return None
    places = np.frombuffer(raw, dtype=np.uint8)
    ends = np.flatnonzero(places == 10)
    commas = np.cumsum(places == 44)[ends]
    if len(ends) == 0 or (np.diff(commas, prepend=0) != width - 1).any():
        return None
    if b",," in raw or b",\n" in raw:
        raw = raw.replace(b",,", b",nan,").replace(b",,", b",nan,").replace(b",\n", b",nan\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of what is no number
        try:
            values = np.fromstring(raw.replace(b"\n", b",").decode("ascii"), sep=",")
        except (DeprecationWarning, ValueError):
            return None
    if len(values) != len(ends) * width:
        return None
    rows = values.reshape(-1, width)
    return rows if np.isfinite(rows[:, 0]).all() else None


def _any_rows(path: str, chunk: _Chunk, columns: Sequence[str]) -> np.ndarray:
    """Return the numbers of lines of any kind. Raises ModelError, with the line."""
    rows = [_row(where, columns, cells) for where, cells in _lines(path, chunk)]
    return np.array(rows, dtype=float).reshape(-1, len(columns) + 1)


def _checked_times(path: str, chunk: _Chunk, time: np.ndarray, newest: float) -> float:
    """Return the newest time so far. Raises ModelError if the time goes back."""
    before = np.maximum.accumulate(np.append(newest, time))
    back = np.flatnonzero(time < before[:-1] - FARTHEST_BACK_S)
    if len(back):
        row = int(back[0])
        for number, (where, _) in enumerate(_lines(path, chunk)):
            if number == row:
                raise ModelError(
                    where,
                    f"the time goes back from {before[row]:g} to {time[row]:g} s; "
                    "a file holds one drive, in the order of time",
                )
    return float(before[-1])


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


def _row(where: str, columns: Sequence[str], cells: Sequence[str]) -> List[float]:
    if len(cells) != len(columns) + 1:
        raise ModelError(where, f"{len(cells)} cells, but there are {len(columns) + 1} columns")
    time = _number(where, TIME, cells[0])
    if not math.isfinite(time) or time == NO_NUMBER:
        raise ModelError(where, f"{TIME} must be a finite number of s, not {cells[0]!a}")
    return [time, *(_number(where, name, cell) for name, cell in zip(columns, cells[1:]))]


def _number(where: str, name: str, cell: str) -> float:
    """Return the number in a cell; NaN if it is empty."""
    if not cell.strip():
        return math.nan
    try:
        number = float(cell)
    except ValueError:
        raise ModelError(where, f"{name} must be a number or empty, not {cell[:40]!a}") from None
    return NO_NUMBER if math.isnan(number) else number


def _series(
    path: str, columns: Sequence[str], table: np.ndarray
) -> Tuple[Tuple[Series, ...], Tuple[str, ...]]:
    """Return a series for each column that has a sample."""
    series: List[Series] = []
    notes: Dict[str, None] = {}
    for place, name in enumerate(columns, 1):
        there = ~np.isnan(table[:, place])
        if not there.any():
            notes[f"{path}: {name} has no sample"] = None
            continue
        order = ordered(table[there, 0])
        values = table[there, place][order.kept]
        notes.update({f"{path}: {note}": None for note in order.notes})
        values[values == NO_NUMBER] = np.nan
        series.append(Series(name, path, "", order.time, values))
    if not series:
        raise ModelError(path, f"holds no value of {listed(columns)}")
    return tuple(series), tuple(notes)

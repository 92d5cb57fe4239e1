"""Time and memory that it takes to read large recordings, whose rows are made as they are read.

    python3 large_recordings.py [--rows N] [--short] [--results DIR]

Prints the goals; leaves large_recordings.csv and large_recordings_goals.csv. Each is read in a
process of its own; what it takes to make the rows is not counted.
"""
import multiprocessing
import resource
from itertools import cycle, islice
from time import perf_counter
from typing import Any, Dict, List

import numpy as np
from report import Goals, arguments, print_table, write_table
from tqdm import tqdm

from shsa_learning.recordings import csv_files

NUMBERS = 10
STEP_S = 0.01
DIFFERENT = 20_000
SHORT = (50_000, 400_000)
COLUMNS = ("rows", "gigabytes", "seconds", "megabytes")


class Made:
    """A file of so many rows of noise; `took`: the time in s that it took to make them."""

    def __init__(self, rows: int) -> None:
        noise = np.random.RandomState(1).normal(size=(DIFFERENT, NUMBERS))
        ends = ["".join(f",{value:.4f}" for value in row) for row in noise]
        self._rows = zip(range(rows), cycle(ends))
        self._rest = f"time,{','.join(f'v{n}' for n in range(NUMBERS))}\n".encode()
        self.took = 0.0

    def __enter__(self) -> "Made":
        return self

    def __exit__(self, *_: Any) -> None:
        pass

    def read(self, size: int) -> bytes:
        """Return what comes next, as a file does."""
        began = perf_counter()
        parts, there = [self._rest], len(self._rest)
        while there < size:
            some = islice(self._rows, 1000)
            made = "".join([f"{number * STEP_S:.2f}{end}\n" for number, end in some]).encode()
            if not made:
                break
            parts.append(made)
            there += len(made)
        whole = b"".join(parts)
        self._rest = whole[size:]
        self.took += perf_counter() - began
        return whole[:size]


def read(rows: int) -> Dict[str, float]:
    """Return what it takes to read so many rows."""
    made = Made(rows)
    setattr(csv_files, "open_to_read", lambda path: made)  # no disk need hold them
    began = perf_counter()
    with tqdm(unit="B", unit_scale=True, desc=f"{rows:,} rows") as progress:
        csv_files.read_csv("made.csv", step=progress.update)
        size = progress.n
    seconds = perf_counter() - began - made.took
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    found = (rows, size / 1e9, seconds, memory)
    return dict(zip(COLUMNS, (round(each, 2) for each in found)))


def main() -> None:
    """Measure, print a table, write the CSV file."""
    options = arguments(__doc__.splitlines()[0], "rows", 125_000_000, "450,000 rows")
    sizes = SHORT if options.short else (5_000_000, options.rows)
    found: List[Dict[str, float]] = []
    for rows in sizes:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            found.append(pool.apply(read, (rows,)))
            pool.close()
            pool.join()
    table = [list(row.values()) for row in found]
    write_table(options.results / "large_recordings.csv", COLUMNS, table)
    told = [[f"{row[name]:,.10g}" for name in COLUMNS] for row in found]
    print_table(f"Recordings of {NUMBERS} values a row", COLUMNS, told)
    goals, (small, large) = Goals(), found
    goals.at_most("time to read", f"{sizes[0]:,} rows", 60.0, small["seconds"], "s")
    goals.at_most("memory", f"{sizes[0]:,} rows", 500.0, small["megabytes"], "MB")
    growth = large["megabytes"] / small["megabytes"]
    goals.at_most("memory, as a ratio", f"{sizes[1]:,} rows beside these", 1.1, growth, "")
    goals.show(options.results / "large_recordings_goals.csv")


if __name__ == "__main__":
    main()

"""Inputs that a target cannot be learned from are left out, each with its reason."""
from typing import Dict, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np

from shsa_learning.learn.refusal import MANY, SHORTEST_S, duplicates, leaks, leak_text, too_still
from shsa_learning.learn.table import Table

LEAST_SHARE = 0.5
"""Of the target's values: an input that has one at fewer of them costs more than it tells."""


class Screened(NamedTuple):
    """The inputs that are left, and the others with their reasons.

    `against`: reasons against the whole, of inputs that somebody asked for.
    """

    table: Table
    left_out: Dict[str, str]
    against: Tuple[str, ...]


def screened(
    table: Table,
    outliers: Mapping[str, int],
    computed_from: Sequence[str] = (),
    asked: Sequence[str] = (),
) -> Screened:
    """Leave out what is hardly there, is constant, rarely varies, or knows the target.

    `outliers` of each input by number; `computed_from`: what the target is computed from may tell
    all of it; `asked`: a leak in what somebody asked for is told, and nothing is learned.
    """
    table, left_out = _there(table)
    rows = table.rows()
    for name in table.names:
        why = too_still(table.inputs[name][rows], table.time[rows])
        why = f"it {why}" if why else ""
        count = outliers.get(name, 0)
        if count > MANY * len(table.time):
            why = f"{100.0 * count / len(table.time):.0f} % of its values are outliers"
        if why:
            left_out[name] = why
    table = table.of(tuple(name for name in table.names if name not in left_out))
    against: List[str] = []
    for leak in leaks(table):
        if leak.name not in computed_from:
            left_out[leak.name] = leak_text(table.name, leak)
            against += [left_out[leak.name]] if leak.name in asked else []
    table = table.of(tuple(name for name in table.names if name not in left_out))
    same = duplicates(table)
    left_out.update({name: f"it says the same as {other}" for name, other in same.items()})
    table = table.of(tuple(name for name in table.names if name not in same))
    return Screened(table, left_out, tuple(against))


def _there(table: Table) -> Tuple[Table, Dict[str, str]]:
    """Leave out, the rarest first, what leaves too few rows in which all inputs have a value."""
    left_out: Dict[str, str] = {}
    known = np.isfinite(table.target)
    count = int(np.count_nonzero(known))
    while table.names:
        least = max(LEAST_SHARE * count, min(SHORTEST_S / max(table.period, 1e-9), count))
        if np.count_nonzero(table.complete) >= least:
            break
        has = {n: int(np.count_nonzero(known & np.isfinite(table.inputs[n]))) for n in table.names}
        name = min(has, key=lambda each: has[each])
        share = 100.0 * has[name] / max(count, 1)
        left_out[name] = f"it has a value at {share:.0f} % of those of {table.name}"
        table = table.of(tuple(each for each in table.names if each != name))
    return table, left_out

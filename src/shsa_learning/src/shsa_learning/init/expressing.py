"""Relations between the properties of a recording, for a first ontology."""
from dataclasses import replace
from typing import Callable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology, TransferFunction
from shsa_core.model.som import Som
from shsa_learning.learn.learner import learn
from shsa_learning.learn.refusal import SKILL
from shsa_learning.learn.relation import relation_of, with_relation
from shsa_learning.learn.rows import gather
from shsa_learning.learn.selection import OUTER
from shsa_learning.learn.table import Fold, Table, blocked
from shsa_learning.recordings.recording import Recording

ALTERNATIVES = 2
"""Relations a property: the second has none of the first one's inputs."""
MODEL = "polynomial"
"""Signed products: short, and quickly fitted. `shsa learn` tries all that there is."""
MOST_INPUTS = 3
"""Each input is one more that may fail."""
FEWEST_ROWS, MOST_ROWS = 100, 3000
GAIN = 0.1
"""By so much of what is left an input must lessen the error, to be worth its place."""
DRIFT = 0.9
"""Correlation with time: of two things that drift, each seems to tell the other."""


class Outcome(NamedTuple):
    """A relation learned for a property, or why there is none."""

    property: str
    relation: Optional[TransferFunction]
    why: str


def express(
    recordings: Sequence[Recording],
    som: Som,
    source: str,
    step: Callable[[], object] = lambda: None,
) -> Iterator[Outcome]:
    """Relations for each property of the SOM that was recorded; `step` is called once for each.

    `source`: where the recordings are from, in words.
    """
    known = {name for recording in recordings for name in recording.properties}
    for name in dict.fromkeys(each.property for each in som.sources):
        if name in known:
            yield from _alternatives(recordings, som, name, source)
        step()


def with_all(ontology: Ontology, outcomes: Sequence[Outcome]) -> Ontology:
    """Return the ontology with all relations that were learned."""
    for outcome in outcomes:
        if outcome.relation is not None:
            ontology = with_relation(ontology, outcome.relation)
    return ontology


def _alternatives(
    recordings: Sequence[Recording], som: Som, name: str, source: str
) -> Iterator[Outcome]:
    used: List[str] = []
    for number in range(1, ALTERNATIVES + 1):
        try:
            chosen = screen(gather(recordings, name, (), som).table, used)
            if not chosen:
                if not used:
                    yield Outcome(name, None, "nothing that was recorded tells enough of it")
                return
            data = gather(recordings, name, chosen, som)
            learned = learn(data, MODEL, source=source)
            used += chosen
            if not learned.accepted:
                inputs = ", ".join(chosen)
                yield Outcome(name, None, f"from {inputs}: {'; '.join(learned.reasons)}")
                continue
            relation = relation_of(learned)
        except ShsaError as error:
            yield Outcome(name, None, str(error))
            return
        alone = (
            relation if number == 1 else replace(relation, relation=f"{relation.relation}_{number}")
        )
        yield Outcome(name, alone, "")


def screen(table: Table, without: Sequence[str] = ()) -> Tuple[str, ...]:
    """Return the inputs that tell most of a table's target, best first; none if none does.

    Each is tried as it is and by its magnitude, on blocks of time that the fit has not seen. What
    drifts all the time tells nothing, and nothing tells it.
    """
    rows = np.flatnonzero(table.complete)
    rows = rows[:: 1 + len(rows) // MOST_ROWS]
    if len(rows) < FEWEST_ROWS:
        return ()
    target, folds = table.target[rows], blocked(table.time[rows], OUTER)
    if _drifts(target, table.time[rows]):
        return ()
    mean = _error(np.ones((len(rows), 1)), target, folds)
    chosen: List[str] = []
    error = mean
    known = {name: table.inputs[name][rows] for name in table.names if name not in without}
    steady = {n: values for n, values in known.items() if not _drifts(values, table.time[rows])}
    columns = {name: _columns(values) for name, values in steady.items()}
    while len(chosen) < MOST_INPUTS and mean > 0.0:
        errors = {
            name: _error(_design([columns[each] for each in (*chosen, name)]), target, folds)
            for name in columns
            if name not in chosen
        }
        if not errors:
            break
        best = min(errors, key=lambda name: errors[name])
        if not errors[best] < (1.0 - GAIN) * error:
            break
        chosen, error = [*chosen, best], errors[best]
    return tuple(chosen) if error < (1.0 - SKILL) * mean else ()


def _drifts(values: np.ndarray, time: np.ndarray) -> bool:
    if np.ptp(values) == 0.0 or np.ptp(time) == 0.0:
        return False
    return abs(float(np.corrcoef(values, time)[0, 1])) > DRIFT


def _columns(values: np.ndarray) -> np.ndarray:
    """Return an input as it is and by its magnitude: (rows, 2), scaled."""
    scale = float(np.std(values)) or 1.0
    return np.array([values - np.mean(values), np.abs(values)]).T / scale


def _design(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.hstack([np.ones((len(parts[0]), 1)), *parts])


def _error(design: np.ndarray, target: np.ndarray, folds: Sequence[Fold]) -> float:
    """Return the RMS error on each fold's test, fitted on the rest."""
    squares, count = 0.0, 0
    for fold in folds:
        found = np.linalg.lstsq(design[fold.train], target[fold.train], rcond=1e-9)[0]
        squares += float(np.sum((target[fold.test] - design[fold.test] @ found) ** 2))
        count += len(fold.test)
    return float(np.sqrt(squares / count)) if count else 0.0

"""Measures how well services, relations and whole substitutes tell what is true.

Accuracy is the root mean square error over the span of the true values in the drive (for the state
of charge, which hardly moves in a drive: over 0 to 1). A quality is 1 minus that, rounded down to
two decimals.
"""
import math
from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

import numpy as np

from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_learning.figures import error_of
from shsa_learning.learn.evaluation import evaluate, evaluate_derivation
from shsa_learning.learn.table import inputs_alone
from shsa_learning.substitutes import find_substitute
from shsa_rover.dataset import Dataset

FULL_SPAN = {"state_of_charge": 1.0}
WARM_UP_S = 60.0  # until the slowest filter has settled


@dataclass(frozen=True)
class Accuracy:
    """The accuracy of `name`: error and span in its unit, and its quality on file."""

    name: str
    output: str
    error: float
    span: float
    stated: float

    @property
    def quality(self) -> float:
        """The measured quality: 1 - error/span, rounded down to two decimals, at least 0.01."""
        return max(0.01, math.floor(100.0 * (1.0 - self.error / self.span) + 1e-9) / 100.0)


def services(som: Som, data: Dataset) -> List[Accuracy]:
    """Return the accuracy of every value of every service."""
    return [
        _accuracy(source.path, source.property, source.quality, data.measured[source.path], data)
        for source in som.sources
    ]


def relations(ontology: Ontology, data: Dataset) -> List[Accuracy]:
    """Return the accuracy of every transfer function that is fed with the truth."""
    results = []
    for function in ontology.functions:
        values = evaluate(function, ontology.constants, inputs_alone(data.time, data.truth))
        name = f"{function.relation}: {function.output}"
        results.append(_accuracy(name, function.output, function.quality, values, data))
    return results


def errors(ontology: Ontology, som: Som, drives: Sequence[Dataset]) -> Dict[Tuple[str, str], Error]:
    """Return each transfer function's error with inputs as usual, by relation and output.

    Each input is what its best service measured, and the truth where it has none.
    """
    best: Dict[str, Tuple[float, str]] = {}
    for source in som.sources:
        error = source.provision.error
        if error is not None:
            best[source.property] = min(
                (error.rms, source.path), best.get(source.property, (math.inf, ""))
            )
    found = {}
    for function in ontology.functions:
        values, truths = [], []
        for data in drives:
            inputs = {
                name: data.measured[best[name][1]] if name in best else data.truth[name]
                for name in function.inputs
            }
            settled = data.time >= WARM_UP_S
            told = evaluate(function, ontology.constants, inputs_alone(data.time, inputs))
            values.append(told[settled])
            truths.append(data.truth[function.output][settled])
        off = np.concatenate(values) - np.concatenate(truths)
        baseline = float(np.std(np.concatenate(truths)))
        found[function.relation, function.output] = error_of(off[np.isfinite(off)], baseline)
    return found


def substitutes(ontology: Ontology, som: Som, data: Dataset) -> List[Accuracy]:
    """Return the accuracy of the best substitute of each value of each needed service.

    It is fed with measurements.

    As at a failure, nothing else of the failed node is used. Raises NoSubstitute if there is none.
    """
    results = []
    for lost in (source for service in som.needed() for source in service.sources):
        without = lost.service.name, lost.node
        found = find_substitute(ontology, som.sources, lost.property, excluded=without)
        values = evaluate_derivation(found.derivation, ontology.constants, data.time, data.measured)
        name = f"{lost.path}: {' < '.join(found.derivation.relations()) or 'passed on'}"
        results.append(_accuracy(name, lost.property, found.quality, values, data))
    return results


def usual_ranges(ontology: Ontology, drives: Sequence[Dataset]) -> Dict[str, Tuple[float, float]]:
    """Return the range of the middle 90 % of the true values of each property, in its unit."""
    found = {}
    for name in ontology.properties:
        columns = [data.truth[name][data.time >= WARM_UP_S] for data in drives]
        lowest, highest = np.percentile(np.concatenate(columns), (5.0, 95.0))
        found[name] = (float(lowest), float(highest))
    return found


def _accuracy(name: str, prop: str, stated: float, values: np.ndarray, data: Dataset) -> Accuracy:
    truth = data.truth[prop]
    settled = (data.time >= WARM_UP_S) & np.isfinite(values)
    error = float(np.sqrt(np.mean((values[settled] - truth[settled]) ** 2)))
    return Accuracy(name, prop, error, FULL_SPAN.get(prop, float(np.ptp(truth))), stated)

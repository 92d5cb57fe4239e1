"""Measures how well services, relations and whole substitutes tell what is true.

Accuracy is the root mean square error over the span of the true values in the drive (for the state
of charge, which hardly moves in a drive: over 0 to 1). A quality is 1 minus that, rounded down to
two decimals.
"""
import math
from dataclasses import dataclass
from typing import Callable, List

import numpy as np

from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import compile_program
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.search.substitutes import Derivation, find_substitute
from shsa_rover.dataset import Dataset

FULL_SPAN = {"state_of_charge": 1.0}
WARM_UP_S = 60.0  # until the slowest filter has settled


@dataclass(frozen=True)
class Accuracy:
    """What was measured of `name`: error and span in its unit, and its quality on file."""

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
    """The accuracy of every value of every service."""
    return [
        _accuracy(source.path, source.property, source.quality, data.measured[source.path], data)
        for source in som.sources
    ]


def relations(ontology: Ontology, data: Dataset) -> List[Accuracy]:
    """The accuracy of every transfer function that is fed with the truth."""
    results = []
    for function in ontology.functions:
        inputs = tuple(Derivation(name, _true(name), None) for name in function.inputs)
        root = Derivation(function.output, None, function, inputs)
        values = _evaluate(root, ontology, data.time, lambda path: data.truth[path.strip("/")[:-2]])
        name = f"{function.relation}: {function.output}"
        results.append(_accuracy(name, function.output, function.quality, values, data))
    return results


def substitutes(ontology: Ontology, som: Som, data: Dataset) -> List[Accuracy]:
    """How accurate the best substitute of each value of each needed service is.

    It is fed with measurements.

    As at a failure, nothing else of the failed node is used. Raises NoSubstitute if there is none.
    """
    results = []
    for lost in (source for service in som.needed() for source in service.sources):
        found = find_substitute(ontology, som.sources, lost.property, excluded=(lost.node,))
        values = _evaluate(found.derivation, ontology, data.time, lambda path: data.measured[path])
        name = f"{lost.path}: {' < '.join(_relations(found.derivation)) or 'passed on'}"
        results.append(_accuracy(name, lost.property, found.quality, values, data))
    return results


def _relations(derivation: Derivation) -> List[str]:
    """The relations used, each once, the last one computed first."""
    own = [derivation.function.relation] if derivation.function else []
    below = [name for child in derivation.inputs for name in _relations(child)]
    return list(dict.fromkeys(own + below))


def _true(name: str) -> Source:
    """A source that tells the true value of the property `name`."""
    provided = (Provision(name, "x"),)
    (source,) = Service(name, f"/{name}", "std_msgs/Float64", "/truth", 0.02, provided).sources
    return source


def _evaluate(
    derivation: Derivation,
    ontology: Ontology,
    time: np.ndarray,
    column: Callable[[str], np.ndarray],
) -> np.ndarray:
    """The generated code of a derivation on recorded inputs.

    Not a number where it has no output.
    """
    program = generate([(derivation, "/result/x")], ontology.constants)
    compiled = compile_program(program.code, len(program.inputs), 1)
    rows = np.array([column(path) for path in program.inputs]).T
    results = (compiled.step(row, now) for row, now in zip(rows.tolist(), time.tolist()))
    return np.array([math.nan if result is None else result[0] for result in results])


def _accuracy(name: str, prop: str, stated: float, values: np.ndarray, data: Dataset) -> Accuracy:
    truth = data.truth[prop]
    settled = (data.time >= WARM_UP_S) & np.isfinite(values)
    error = float(np.sqrt(np.mean((values[settled] - truth[settled]) ** 2)))
    return Accuracy(name, prop, error, FULL_SPAN.get(prop, float(np.ptp(truth))), stated)

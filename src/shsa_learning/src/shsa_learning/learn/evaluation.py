"""Relations evaluated on rows by the very code that a substitute runs"""
import math
from itertools import repeat
from typing import Iterable, Mapping, NamedTuple, Sequence, Tuple

import numpy as np

from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import compile_program
from shsa_core.errors import ModelError
from shsa_core.model.ontology import Constant, Ontology
from shsa_core.model.relation import TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.search.derivation import Derivation
from shsa_learning.learn.table import Table

AGREEMENT = 1e-9  # of the largest value, or of 1
LEARNED = "learned_"
"""The prefix of the names of learned relations."""


def evaluate(
    function: TransferFunction,
    constants: Mapping[str, Constant],
    time: np.ndarray,
    inputs: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Run the generated code of a relation at each `time` (s); NaN where it has no output.

    `inputs` by property; others than the relation's are not looked at. Raises GenerationError if
    there is no code for it.
    """
    sources = {name: _source(name) for name in function.inputs}
    given = tuple(Derivation(name, source, None) for name, source in sources.items())
    root = Derivation(function.output, None, function, given)
    columns = {source.path: inputs[name] for name, source in sources.items()}
    return evaluate_derivation(root, constants, time, columns)


def evaluate_derivation(
    derivation: Derivation,
    constants: Mapping[str, Constant],
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Run the generated code of a derivation at each `time` (s); NaN where it has no output.

    `columns` by topic and field. Raises GenerationError if there is no code for it.
    """
    program = generate([(derivation, "/result/x")], constants)
    step = compile_program(program.code, len(program.inputs), 1).step
    read = [columns[path].tolist() for path in program.inputs]
    rows: Iterable[Sequence[float]] = zip(*read) if read else repeat(())
    results = (step(row, now) for row, now in zip(rows, time.tolist()))
    return np.array([math.nan if result is None else result[0] for result in results])


def check_agreement(
    function: TransferFunction,
    constants: Mapping[str, Constant],
    table: Table,
    fitted: np.ndarray,
) -> float:
    """Return the largest difference of the generated code and the fitted model on these rows.

    Raises ModelError if that is more than AGREEMENT.
    """
    generated = evaluate(function, constants, table.time, table.inputs)
    both = np.isfinite(generated) & np.isfinite(fitted)
    where = f"the relation {function.relation}"
    if not both.any():
        raise ModelError(where, "its generated code gives no value on the data it was fitted to")
    off = np.abs(generated[both] - fitted[both])
    worst = float(np.max(off / np.maximum(np.abs(fitted[both]), 1.0)))
    if not worst <= AGREEMENT:
        raise ModelError(where, f"its generated code is off the fitted model by {worst:.2g}")
    return worst


class Known(NamedTuple):
    """A relation whose numbers are known, and what it says of each row of a table."""

    function: TransferFunction
    said: np.ndarray


def laws(ontology: Ontology, table: Table) -> Mapping[str, Known]:
    """Run each relation of the ontology that yields the target from inputs of the table.

    Learned ones do not compete: they may have been learned from the same rows.
    """
    return {
        function.relation: Known(
            function, evaluate(function, ontology.constants, table.time, table.inputs)
        )
        for function in ontology.functions
        if function.output == table.name
        and function.law is not None
        and function.inputs
        and not function.relation.startswith(LEARNED)
        and set(function.inputs) <= set(table.names)
    }


def _source(name: str) -> Source:
    provided: Tuple[Provision, ...] = (Provision(name, "x"),)
    (source,) = Service(name, f"/{name}", "std_msgs/Float64", "/data", 0.02, provided).sources
    return source

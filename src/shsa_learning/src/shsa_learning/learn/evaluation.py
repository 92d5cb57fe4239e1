"""Relations evaluated on rows by the very code that a substitute runs"""
import math
from itertools import repeat
from typing import Iterable, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import compile_program
from shsa_learning.units.unit import Unit, parse_unit
from shsa_core.model.ontology import Constant, Ontology, TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.search.derivation import Derivation
from shsa_learning.learn.table import Table

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
    return evaluate_all([function], constants, time, inputs)[0]


def evaluate_all(
    functions: Sequence[TransferFunction],
    constants: Mapping[str, Constant],
    time: np.ndarray,
    inputs: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Run relations in one program: a row for each of them, NaN wherever one has no output."""
    used = dict.fromkeys(name for function in functions for name in function.inputs)
    sources = {name: _source(name) for name in used}
    given = {name: Derivation(name, source, None) for name, source in sources.items()}
    roots = [
        Derivation(each.output, None, each, tuple(given[name] for name in each.inputs))
        for each in functions
    ]
    columns = {source.path: inputs[name] for name, source in sources.items()}
    return _run(roots, constants, time, columns)


def evaluate_derivation(
    derivation: Derivation,
    constants: Mapping[str, Constant],
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Run the generated code of a derivation at each `time` (s); NaN where it has no output.

    `columns` by topic and field. Raises GenerationError if there is no code for it.
    """
    return _run([derivation], constants, time, columns)[0]


def _run(
    derivations: Sequence[Derivation],
    constants: Mapping[str, Constant],
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
) -> np.ndarray:
    outputs = [(each, f"/result/x{number}") for number, each in enumerate(derivations)]
    program = generate(outputs, constants)
    step = compile_program(program.code, len(program.inputs), len(outputs)).step
    read = [columns[path].tolist() for path in program.inputs]
    rows: Iterable[Sequence[float]] = zip(*read) if read else repeat(())
    none = (math.nan,) * len(outputs)
    results = [step(row, now) or none for row, now in zip(rows, time.tolist())]
    return np.array(results, dtype=float).reshape(-1, len(outputs)).T


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


class Knowledge(NamedTuple):
    """The units of inputs (None: not known), and laws over them as expressions."""

    units: Mapping[str, Optional[Unit]] = {}
    laws: Tuple[str, ...] = ()


def knowledge(ontology: Ontology, table: Table) -> Knowledge:
    """Return what an ontology knows of the inputs of a table: its laws of one expression are terms.

    Whatever such a law yields, a target may be made of it.
    """
    units = {
        name: parse_unit(ontology.properties[name].unit)
        for name in table.names
        if name in ontology.properties
    }
    values = {name: repr(constant.value) for name, constant in ontology.constants.items()}
    terms = []
    for function in ontology.functions:
        law = function.law
        if law is None or law.steps or not function.inputs or function.output == table.name:
            continue
        if set(function.inputs) <= set(table.names):
            names = {name: values.get(name, name) for name in law.names}
            terms.append(f"({law.result.code(names)})")
    return Knowledge(units, tuple(terms))


def _source(name: str) -> Source:
    provided: Tuple[Provision, ...] = (Provision(name, "x"),)
    (source,) = Service(name, f"/{name}", "std_msgs/Float64", "/data", 0.02, provided).sources
    return source

"""Relations evaluated on rows by the very code that a substitute runs"""
import math
from itertools import repeat
from types import MappingProxyType
from typing import Iterable, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.codegen.generator import generate, inputs_of
from shsa_core.codegen.program import compile_periodic
from shsa_learning.units.unit import Unit, parse_unit
from shsa_core.model.ontology import Constant, Ontology, TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.search.derivation import Derivation
from shsa_learning.learn.table import Table
from shsa_learning.recordings.recording import sample_times_of

LEARNED = "learned_"
"""The prefix of the names of learned relations."""


def evaluate(
    function: TransferFunction, constants: Mapping[str, Constant], table: Table
) -> np.ndarray:
    """Run the generated code of a relation on each row of a table; NaN where it has no output.

    Raises GenerationError if there is no code for it.
    """
    return evaluate_all([function], constants, table)[0]


def evaluate_all(
    functions: Sequence[TransferFunction], constants: Mapping[str, Constant], table: Table
) -> np.ndarray:
    """Run relations in one program: a row for each of them, NaN wherever one has no output."""
    used = dict.fromkeys(name for function in functions for name in function.inputs)
    sources = {name: _source(name, name in table.angles) for name in used}
    given = {name: Derivation(name, source, None) for name, source in sources.items()}
    roots = [
        Derivation(each.output, None, each, tuple(given[name] for name in each.inputs))
        for each in functions
    ]
    columns = {source.path: table.inputs[name] for name, source in sources.items()}
    known = {sources[name].path: table.moments[name] for name in used if name in table.moments}
    return _run(roots, constants, table.time, columns, known)


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
    moments: Mapping[str, np.ndarray] = MappingProxyType({}),
) -> np.ndarray:
    outputs = [(each, f"/result/x{number}") for number, each in enumerate(derivations)]
    program = generate(outputs, constants)
    inputs = [(each.provision.field, None) for each in inputs_of(derivations)]
    compiled = compile_periodic(program.code, inputs, len(outputs), 0.0)
    read = [columns[path].tolist() for path in program.inputs]
    rows: Iterable[Sequence[float]] = zip(*read) if read else repeat(())
    holds = np.full(len(time), np.nan)
    came = [moments.get(path, holds) for path in program.inputs]
    at = sample_times_of(came, time) if compiled.timed else repeat(())
    none = (math.nan,) * len(outputs)
    steps = zip(rows, time.tolist(), at)
    results = [compiled.step(row, now, times) or none for row, now, times in steps]
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
        function.relation: Known(function, evaluate(function, ontology.constants, table))
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


def _source(name: str, angle: bool) -> Source:
    provided: Tuple[Provision, ...] = (Provision(name, "yaw(x)" if angle else "x"),)
    (source,) = Service(name, f"/{name}", "std_msgs/Float64", "/data", 0.02, provided).sources
    return source

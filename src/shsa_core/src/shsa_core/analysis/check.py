"""Checks an ontology and a SOM before they are relied on: `shsa check`."""
import re
from dataclasses import dataclass
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Set, Tuple, Union

from shsa_core.analysis.failures import Failures
from shsa_core.codegen.generator import generate
from shsa_core.errors import GenerationError, ModelError, NoSubstitute, UnitError
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.som_file import load_som
from shsa_core.language.interval import Interval
from shsa_core.language.units import Unit, parse_unit
from shsa_core.model.ontology import Constant, Ontology, Property
from shsa_core.model.relation import TransferFunction
from shsa_core.model.service import Provision, Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import LOST, Derivation


@dataclass(frozen=True)
class Finding:
    """One thing that a check found: where (file and line), what, and what to do.

    `level` is error or warning.
    """

    level: str
    where: str
    what: str
    todo: str = ""

    def __str__(self) -> str:
        text = f"{self.where}: {self.level}: {self.what}"
        return f"{text}. {self.todo}." if self.todo else text


def check_files(ontology_path: str, som_path: Optional[str] = None) -> List[Finding]:
    """Everything found in the files, by file and line.

    The model is valid if no finding is an error.
    """
    try:
        ontology, errors = load_ontology(ontology_path)
    except ModelError as error:
        return [_from_error(error)]
    som = None
    if som_path is not None:
        try:
            som, som_errors = load_som(som_path)
            errors = errors + som_errors
        except ModelError as error:
            errors = errors + [error]
    findings = [_from_error(error) for error in errors] + check_model(ontology, som)
    return sorted(findings, key=lambda f: (f.level != "error", _place(f.where)))


def check_model(ontology: Ontology, som: Optional[Som] = None) -> List[Finding]:
    """Everything found in an ontology, and in a SOM if there is one."""
    findings = list(_check_units(ontology))
    findings += _check_functions(ontology)
    if som is not None:
        known = [s for s in som.sources if s.property in ontology.properties]
        findings += _check_names(ontology, som)
        findings += _check_ranges(ontology, known)
        findings += _check_reach(ontology, known)
        findings += _check_needed(ontology, som, known)
    return findings


def _from_error(error: ModelError) -> Finding:
    return Finding("error", error.where, error.what)


def _place(where: str) -> Tuple[str, int]:
    match = re.match(r"(.*):(\d+)\Z", where)
    return (match.group(1), int(match.group(2))) if match else (where, 0)


def _check_units(ontology: Ontology) -> Iterator[Finding]:
    units: Dict[str, Optional[Unit]] = {}
    items: List[Union[Property, Constant]] = [*ontology.properties.values()]
    for item in [*items, *ontology.constants.values()]:
        units[item.name] = None
        try:
            units[item.name] = parse_unit(item.unit)
        except UnitError as error:
            yield Finding("error", item.where, f"{item.name}: {error}")
    for function in ontology.functions:
        if function.law is None:
            continue
        mismatches = function.law.mismatches(units, units[function.output])
        if function.constraint is not None:
            mismatches += function.constraint.mismatches(units)
        for text, sure in dict.fromkeys(mismatches):
            yield Finding(
                "error" if sure else "warning",
                function.where,
                f"units of {_name(function)}: {text}",
                "Correct the function or the units"
                if sure
                else "Correct it, or give the number that carries a unit a name in 'constants'",
            )


def _check_functions(ontology: Ontology) -> Iterator[Finding]:
    for function in ontology.functions:
        if function.law is None:
            yield Finding(
                "warning",
                function.where,
                f"{_name(function)} cannot be executed: {function.text!r}",
                "Searches count it, but no substitute can be made of it: write it as an expression",
            )
            continue
        inputs = tuple(
            Derivation(name, source, None)
            for name, source in zip(function.inputs, _sources_of(function.inputs))
        )
        derivation = Derivation(function.output, None, function, inputs)
        try:
            generate([(derivation, "/output/data")], ontology.constants)
        except GenerationError as error:
            yield Finding("error", function.where, str(error), "Correct the function or a constant")


def _check_names(ontology: Ontology, som: Som) -> Iterator[Finding]:
    for source in som.sources:
        if source.property not in ontology.properties:
            kind = "is a constant" if source.property in ontology.constants else "is not"
            yield Finding(
                "error",
                source.provision.where,
                f"{source.service.name} provides '{source.property}', which {kind} in the ontology",
                "Correct the name, or add it to 'properties'",
            )


def _check_ranges(ontology: Ontology, sources: Iterable[Source]) -> Iterator[Finding]:
    ranges = _declared_ranges(ontology, sources)
    for function in ontology.functions:
        if function.law is None:
            continue
        names = [*function.law.names, *(function.constraint.names if function.constraint else ())]
        own = {name: ranges[name] for name in names if name in ranges}
        if function.constraint is not None:
            own = function.constraint.narrowed(own)
        for trouble in function.law.troubles(own):
            yield Finding(
                "warning",
                function.where,
                f"{_name(function)}: {trouble.part} {trouble.reason}; there is no output then",
                "If that is too often, add a constraint, or narrow the ranges in the SOM",
            )


def _declared_ranges(ontology: Ontology, sources: Iterable[Source]) -> Mapping[str, Interval]:
    ranges = {c.name: Interval(c.value, c.value) for c in ontology.constants.values()}
    open_ends: Set[str] = set()
    for source in sources:
        if source.provision.range is None:
            open_ends.add(source.property)
            continue
        low, high = source.provision.range
        old = ranges.get(source.property, Interval(low, high))
        ranges[source.property] = Interval(min(low, old.low), max(high, old.high))
    return {name: interval for name, interval in ranges.items() if name not in open_ends}


def _check_reach(ontology: Ontology, sources: Iterable[Source]) -> Iterator[Finding]:
    reached = _reachable(ontology, {source.property for source in sources})
    for item in ontology.properties.values():
        if item.name not in reached:
            yield Finding(
                "warning",
                item.where,
                f"{item.name} cannot be reached: no service provides it, "
                "and no relation yields it from what services provide",
                "Add a service or a relation, or remove the property",
            )


def _reachable(ontology: Ontology, provided: Set[str]) -> Set[str]:
    """The provided properties and all that relations yield from them."""
    users: Dict[str, List[int]] = {}
    missing = [len(function.inputs) for function in ontology.functions]
    for index, function in enumerate(ontology.functions):
        for name in function.inputs:
            users.setdefault(name, []).append(index)
    reached: Set[str] = set()
    waiting = list(provided)
    waiting += [f.output for f, count in zip(ontology.functions, missing) if count == 0]
    while waiting:
        name = waiting.pop()
        if name in reached:
            continue
        reached.add(name)
        for index in users.get(name, []):
            missing[index] -= 1
            if missing[index] == 0:
                waiting.append(ontology.functions[index].output)
    return reached


def _check_needed(ontology: Ontology, som: Som, sources: List[Source]) -> Iterator[Finding]:
    failures = Failures(ontology.network, sources)
    for service in som.needed():
        failure = failures.after([service.node])
        known = [name for name in service.properties if name in ontology.properties]
        numbers = {name: ontology.network.number(name) for name in known}
        lost = [name for name in known if failure.ratings[numbers[name]] == LOST]
        if lost:
            missing = {m for name in lost for m in failures.missing(numbers[name], failure)}
            yield Finding(
                "warning",
                service.where,
                f"{service.name} is needed, but if {service.node} fails there is "
                f"{NoSubstitute(lost, sorted(missing))}",
                "Add a relation or a service that yields what is missing",
            )


def _sources_of(names: Iterable[str]) -> Tuple[Source, ...]:
    """Sources of some properties, all of one service."""
    provides = tuple(Provision(name, name) for name in names)
    return Service("all", "/all", "package/Type", "/node", None, provides).sources


def _name(function: TransferFunction) -> str:
    return f"{function.relation} for {function.output}"

"""Checks an ontology and a SOM before they are relied on: `shsa check`."""
import re
from dataclasses import dataclass
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Set, Tuple, Union

from shsa_core.codegen.generator import generate
from shsa_core.errors import GenerationError, ModelError, NoSubstitute, UnitError
from shsa_core.language.interval import Interval, find_troubles
from shsa_core.model.ontology import Constant, Ontology, Property
from shsa_core.model.relation import TransferFunction
from shsa_core.files.ontology_file import load_ontology
from shsa_core.model.som import Service, Som, load_som
from shsa_core.language.units import Unit, find_mismatches, parse_unit
from shsa_core.search.derivation import Derivation
from shsa_core.search.substitutes import find_substitute


@dataclass(frozen=True)
class Finding:
    """One thing that a check found: where (file and line), what, and what to do. `level` is error or warning."""

    level: str
    where: str
    what: str
    todo: str = ""

    def __str__(self) -> str:
        text = f"{self.where}: {self.level}: {self.what}"
        return f"{text}. {self.todo}." if self.todo else text


def check_files(ontology_path: str, som_path: Optional[str] = None) -> List[Finding]:
    """Everything found in the files, by file and line. The model is valid if no finding is an error."""
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
        known = [s for s in som if s.property in ontology.properties]
        findings += _check_names(ontology, som)
        findings += _check_ranges(ontology, known)
        findings += _check_reach(ontology, known)
        findings += _check_needed(ontology, known)
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
        if function.expression is None:
            continue
        constraint = function.constraint.tree() if function.constraint else None
        mismatches = find_mismatches(
            function.expression.tree(), constraint, units, units[function.output]
        )
        for text, sure in mismatches:
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
        if function.expression is None:
            yield Finding(
                "warning",
                function.where,
                f"{_name(function)} cannot be executed: {function.text!r}",
                "Searches count it, but no substitute can be made of it: write it as an expression",
            )
            continue
        inputs = tuple(
            Derivation(name, Service(name, "/topic", f"f{i}", "p/T", "/node", 1.0), None)
            for i, name in enumerate(function.inputs)
        )
        derivation = Derivation(function.output, None, function, inputs)
        try:
            generate([(derivation, "/output/data")], ontology.constants)
        except GenerationError as error:
            yield Finding("error", function.where, str(error), "Correct the function or a constant")


def _check_names(ontology: Ontology, som: Som) -> Iterator[Finding]:
    for service in som:
        if service.property not in ontology.properties:
            kind = "is a constant" if service.property in ontology.constants else "is not"
            yield Finding(
                "error",
                service.where,
                f"{service.path} provides '{service.property}', which {kind} in the ontology",
                "Correct the name, or add it to 'properties'",
            )


def _check_ranges(ontology: Ontology, services: Iterable[Service]) -> Iterator[Finding]:
    ranges = _declared_ranges(ontology, services)
    for function in ontology.functions:
        if function.expression is None:
            continue
        constraint = function.constraint.tree() if function.constraint else None
        expression = function.expression
        for trouble in find_troubles(expression.text, expression.tree(), constraint, ranges):
            yield Finding(
                "warning",
                function.where,
                f"{_name(function)}: {trouble.part} {trouble.reason}; there is no output then",
                "If that is too often, add a constraint, or narrow the ranges in the SOM",
            )


def _declared_ranges(ontology: Ontology, services: Iterable[Service]) -> Mapping[str, Interval]:
    ranges = {c.name: Interval(c.value, c.value) for c in ontology.constants.values()}
    open_ends: Set[str] = set()
    for service in services:
        if service.range is None:
            open_ends.add(service.property)
            continue
        low, high = service.range
        old = ranges.get(service.property, Interval(low, high))
        ranges[service.property] = Interval(min(low, old.low), max(high, old.high))
    return {name: interval for name, interval in ranges.items() if name not in open_ends}


def _check_reach(ontology: Ontology, services: Iterable[Service]) -> Iterator[Finding]:
    reached = _reachable(ontology, {service.property for service in services})
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


def _check_needed(ontology: Ontology, services: List[Service]) -> Iterator[Finding]:
    for service in services:
        if service.needed:
            lost = (service.topic, service.node)
            try:
                find_substitute(ontology, services, service.property, lost)
            except NoSubstitute as none:
                yield Finding(
                    "warning",
                    service.where,
                    f"{service.topic} is needed, but if {service.node} fails there is {none}",
                    "Add a relation or a service that yields what is missing",
                )


def _name(function: TransferFunction) -> str:
    return f"{function.relation} for {function.output}"

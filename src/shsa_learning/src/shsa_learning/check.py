"""Checks an ontology and a SOM before they are relied on: `shsa check`."""
import re
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

from shsa_core.analysis import budget
from shsa_core.analysis.check import function_errors, name_errors
from shsa_core.codegen.generator import generate_function
from shsa_core.codegen.plans import Plan, read_alone
from shsa_core.codegen.program import INTEGRAL, compile_program
from shsa_core.errors import GenerationError, ModelError, NoSubstitute, listed
from shsa_core.files.document import Entry, read_yaml
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.som_file import load_som, refuse_others_commands
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.field import is_angle
from shsa_core.model.kinds import Standby
from shsa_core.model.names import full_name
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import SourceTable
from shsa_core.text import nearest
from shsa_learning.finding import Finding
from shsa_learning.ranges.analysis import find_troubles, narrowed
from shsa_learning.ranges.interval import Interval
from shsa_learning.schedulability import check_placements, takeovers
from shsa_learning.type_check import check_healable, check_types
from shsa_learning.units.mismatches import check_angles, check_units

SLOW = 5.0  # periods of a service: an input that is slower makes it repeat old values


def check_files(
    ontology_path: str,
    som_path: Optional[str] = None,
    types: Any = None,
    namespace: str = "/",
) -> List[Finding]:
    """Return everything found in the files, by file and line.

    The model is valid if no finding is an error. Without `types`, there is no ROS: neither message
    types nor a robot that runs are looked at.
    """
    try:
        ontology, errors = load_ontology(ontology_path)
    except ModelError as error:
        return [_from_error(error)]
    som = None
    if som_path is not None:
        try:
            som, som_errors = load_som(som_path, namespace)
            som = som if types is None else with_unknowns(som, types.layout)
            errors = errors + som_errors
        except ModelError as error:
            errors = errors + [error]
    findings = [_from_error(error) for error in errors] + check_model(ontology, som)
    written = _written(som_path) if som is not None and som_path is not None else {}
    if som is not None:
        findings += _check_sources(som, written, namespace)
    if som is not None and types is not None:
        findings += check_types(som, types, written)
        from shsa_learning.ros import checks  # it needs ROS

        findings += checks.check_running(som, namespace)
    if som is not None and som_path is not None:
        findings += _check_who_writes(som, som_path)
    return sorted(findings, key=lambda f: (f.level != "error", _place(f.where)))


def check_model(ontology: Ontology, som: Optional[Som] = None) -> List[Finding]:
    """Return everything found in an ontology, and in a SOM if there is one."""
    findings = [*check_units(ontology), *_check_functions(ontology), *check_laws(ontology)]
    if som is not None:
        known = [s for s in som.sources if s.property in ontology.properties]
        findings += _check_names(ontology, som)
        findings += check_angles(ontology, som)
        findings += _check_wishes(ontology, som)
        findings += _check_reach(ontology, known)
        findings += _check_needed(ontology, som)
        findings += check_healable(som)
        findings += _check_gates(som)
        findings += _check_budgets(som)
        findings += check_placements(ontology, som)
        findings += _check_loops(som)
        findings += _check_values(ontology, som)
    return findings


def _check_who_writes(som: Som, path: str) -> Iterator[Finding]:
    try:
        refuse_others_commands(som, path)
    except ModelError as error:
        todo = "Healing refuses it here: keep it from others"
        yield Finding("warning", path, error.what, todo)


def _from_error(error: ModelError, todo: str = "") -> Finding:
    return Finding("error", error.where, error.what, todo)


def _place(where: str) -> Tuple[str, int]:
    match = re.match(r"(.*):(\d+)\Z", where)
    return (match.group(1), int(match.group(2))) if match else (where, 0)


def _check_functions(ontology: Ontology) -> Iterator[Finding]:
    todo = "Correct the function or a constant"
    return (_from_error(error, todo) for error in function_errors(ontology))


def _check_names(ontology: Ontology, som: Som) -> Iterator[Finding]:
    todo = "Correct the name, or add it to 'properties'"
    return (_from_error(error, todo) for error in name_errors(ontology, som))


def _check_budgets(som: Som) -> Iterator[Finding]:
    return (Finding("warning", *late, budget.TODO) for late in budget.check_budgets(som))


def check_laws(ontology: Ontology) -> Iterator[Finding]:
    """Report the functions of an ontology that are not computed, or not as a reader expects."""
    for function in ontology.functions:
        name = f"{function.relation} for {function.output}"
        if function.law is None:
            what = f"{name} cannot be executed: {function.text!r}"
            todo = "Searches count it, but no substitute is made of it: write it as an expression"
            yield Finding("warning", function.where, what, todo)
            continue
        try:
            code = generate_function(function, ontology.constants).code
        except GenerationError:
            continue  # that is an error
        if INTEGRAL in code and compile_program(code, len(function.inputs), 1).hidden:
            what = f"{name}: an integral within an expression starts at 0 in a substitute"
            todo = "Give the integral a property and a relation of its own: "
            todo += "a lost value that is nothing but an integral starts at its last good value"
            yield Finding("warning", function.where, what, todo)


def _check_wishes(ontology: Ontology, som: Som) -> Iterator[Finding]:
    relations = {function.relation for function in ontology.functions}
    nodes = {service.node for service in som}
    for service in som:
        strange = [f"prefers the relation {r}" for r in service.prefer if r not in relations]
        strange += [f"avoids the node {node}" for node in service.avoid if node not in nodes]
        for wish in strange:
            what = f"{service.name} {wish}, which is not there"
            yield Finding("warning", service.where, what, "Correct the name, or remove it")


def _written(path: str) -> Dict[str, Entry]:
    """Return the keys of each service as they stand in a SOM file, with their lines."""
    services = read_yaml(path).mapping("the SOM").get("services")
    entries = services.mapping("services") if services is not None else {}
    return {name: each.data for name, each in entries.items() if isinstance(each.data, dict)}


def _check_sources(som: Som, written: Mapping[str, Entry], namespace: str) -> Iterator[Finding]:
    """Report what `derived_from` names that is not there; a topic with a `/` need not be."""
    services = {*som.services, *written}
    for service in (each for each in som if "derived_from" in written.get(each.name, ())):
        for item in written[service.name]["derived_from"].sequence("derived_from"):
            name = item.string("a name in derived_from")
            there = name in services or full_name(name, namespace) in som.topics()
            if not name.startswith("/") and not there:
                what = f"{service.name} is derived from the service {name}, which is not there"
                todo = "Correct the name, write a topic as /topic, or remove it"
                yield Finding("warning", item.where, what + nearest(name, services), todo)


def _check_reach(ontology: Ontology, sources: Iterable[Source]) -> Iterator[Finding]:
    network = ontology.network
    best = BestDerivations(SourceTable(network, sources))
    for item in ontology.properties.values():
        if not best.settle(network.number(item.name)):
            what = f"{item.name} cannot be reached: no service provides it, "
            what += "and no relation yields it from what services provide"
            todo = "Add a service or a relation, or remove the property"
            yield Finding("warning", item.where, what, todo)


def _check_needed(ontology: Ontology, som: Som) -> Iterator[Finding]:
    plan_of = takeovers(ontology, som.sources)
    apart = len({service.host for service in som}) > 1  # else nothing could do without the one host
    for service in som:
        if service.needed is False or read_alone(service) or not service.policy.plans:
            continue  # check_healable says it, or nobody looks for a substitute
        may_be = "is" if service.needed else "may be"
        what = f"{service.name} {may_be} needed, but if {service.node} fails there is"
        todo = "Add a relation or a service that yields what is missing"
        try:
            plan = plan_of(service)
        except NoSubstitute as none:
            todo += _leave_out(none.in_the_way)
            if service.needed or none.in_the_way:
                yield Finding("warning", service.where, f"{what} {none}", todo)
        except GenerationError as error:
            todo = "Write the relation as an expression, or add another one"
            yield Finding("warning", service.where, f"{what} no substitute for it: {error}", todo)
        else:
            if plan.left_out:
                what = f"{what} a substitute for part of it: {plan.lacks}"
                yield Finding("warning", service.where, what, todo + _leave_out(plan.left_out))
            causes = service.shared if apart else service.fails_with
            yield from _check_plan(service, plan, causes)


def _leave_out(names: Sequence[str]) -> str:
    """Return a way out, where some values stand in the way of others."""
    return f", or leave {listed(names)} out of its 'provides'" if names else ""


def _check_gates(som: Som) -> Iterator[Finding]:
    """Report gates without a hot substitute, which have nothing to publish instead of a message."""
    for service in som:
        if service.gated and not (service.needed and service.standby is Standby.HOT):
            what = f"{service.name} has a gate, but no hot substitute: what the gate suppresses is "
            todo = "Say 'needed: true' and 'standby: hot'"
            yield Finding("warning", service.where, f"{what}missing", todo)


def _check_plan(service: Service, plan: Plan, causes: Iterable[str]) -> Iterator[Finding]:
    """Report what a substitute's quality does not tell; it should avoid `causes`."""
    shared = {c: source for source in plan.inputs for c in source.service.shared}
    for cause in (cause for cause in causes if cause in shared):
        what = f"{service.name} is needed, and fails with {cause}; "
        what += f"so does {shared[cause].service.name}, which its substitute reads"
        todo = f"Add a relation or a service that does without {cause}"
        yield Finding("warning", service.where, what, todo)
    turned = [s for s in plan.inputs if is_angle(s.provision.field)]
    told = any(is_angle(each.provision.field) for each in plan.outputs)
    if turned and (told or INTEGRAL in plan.program.code):
        what = f"the substitute of {service.name} reads an angle of {turned[0].service.name}, "
        what += "whose zero may be another"
        todo = f"An angle that {service.name} provides has its offset learned in a minute, else "
        todo += "goes on from the last good one. Where it provides none, integrate a rate"
        yield Finding("warning", service.where, what, todo)
    slow = slowest(service, plan.inputs)
    if slow is not None:
        what = f"{service.name} comes every {service.period:g} s; its substitute reads "
        what += f"{slow.service.name}, which comes every {slow.service.period:g} s: "
        what += "in between it repeats what is old"
        todo = "Add a faster service, or lower the quality of the slow one"
        yield Finding("warning", service.where, what, todo)


def slowest(service: Service, reads: Iterable[Source]) -> Optional[Source]:
    """Return the slowest of some sources, if it is more than SLOW times as slow as the service."""
    periodic = [source for source in reads if source.service.period is not None]
    slow = max(periodic, key=lambda source: source.service.period or 0.0, default=None)
    if slow is None or service.period is None:
        return None
    return slow if (slow.service.period or 0.0) > SLOW * service.period else None


def _check_loops(som: Som) -> Iterator[Finding]:
    """Report services that are derived from what is derived from them."""
    for service in som:
        for name in (each for each in service.upstream if each in som.services):
            if service.name in som.services[name].upstream:
                yield Finding(
                    "error",
                    service.where,
                    f"{service.name} is derived from {name}, which is derived from {service.name}: "
                    "such a loop holds whatever it starts from",
                    "Say in 'derived_from' what each node reads, and let one of them read less",
                )


def _check_values(ontology: Ontology, som: Som) -> Iterator[Finding]:
    """Report the parts of functions that may have no value within the ranges of the services."""
    ranges = _declared_ranges(ontology, som.sources)
    for function in ontology.functions:
        if function.law is None:
            continue
        names = [*function.law.names, *(function.constraint.names if function.constraint else ())]
        always = {name: ranges[name] for name in names if name in ranges}
        own, troubles = always, []
        if function.constraint is not None:
            troubles = find_troubles(function.constraint, always)
            own = narrowed(function.constraint, always)
        for trouble in dict.fromkeys([*troubles, *find_troubles(function.law, own, always)]):
            yield Finding(
                "warning",
                function.where,
                f"{function.relation} for {function.output}: {trouble.part} {trouble.reason}; "
                "there is no output then",
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

"""Finds more for `shsa check`, where this package is installed.

Functions that may have no value; and services that are derived from each other.
"""
from typing import Iterable, Iterator, Mapping, Set

from shsa_core.analysis.finding import Finding
from shsa_learning.ranges.interval import Interval
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.model.som import Som
from shsa_learning.ranges.analysis import find_troubles, narrowed


def check(ontology: Ontology, som: Som) -> Iterator[Finding]:
    """Report functions that may have no value, and loops through consumers."""
    yield from _check_loops(som)
    yield from _check_functions(ontology, som)


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


def _check_functions(ontology: Ontology, som: Som) -> Iterator[Finding]:
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

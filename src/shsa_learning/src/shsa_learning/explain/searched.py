"""The search of an incident, made again: each derivation, and why it could be used, or not."""
from dataclasses import dataclass
from itertools import islice
from typing import FrozenSet, List, Optional, Set, Tuple

from shsa_core.codegen.plans import plan_service, program_of
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import GenerationError, NoSubstitute, ShsaError
from shsa_core.healing.incident import Incident
from shsa_core.model.error import Error, refusal
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_learning.loss import DeadBranch, Loss, dead_branches
from shsa_learning.substitutes import substitutes

LOOKED_AT = 100
"""Derivations of a property that are looked at."""
MOST_SHOWN = 10
"""Derivations of a property that could be used, those that could not, and dead branches."""


@dataclass(frozen=True)
class Found:
    """A derivation of a lost property.

    `why_not`: why it could not be used, each reason in words; none: it could. `ran`: it is what the
    substitute computed.
    """

    relations: Tuple[str, ...]
    inputs: Tuple[str, ...]
    quality: float
    error: Optional[Error]
    why_not: Tuple[str, ...]
    ran: bool


@dataclass(frozen=True)
class Searched:
    """The derivations of one property, best first; `complete`: there is no other one.

    `dead`: the relations that lack an input, and the input: the lost one, or one of no service.
    """

    property: str
    found: Tuple[Found, ...]
    complete: bool
    dead: Tuple[DeadBranch, ...]


@dataclass(frozen=True)
class Search:
    """The search of an incident, made again from what was available then.

    `answer`: in words what the models as they are now answer as a whole.
    """

    properties: Tuple[Searched, ...]
    answer: str


def search_again(ontology: Ontology, som: Som, incident: Incident) -> Search:
    """Search for the substitute of an incident again, and tell what was turned down.

    Raises ShsaError if the models do not know its service.
    """
    service = som.services.get(incident.service)
    if service is None:
        raise ShsaError(f"the SOM has no service {incident.service}: it is of another robot")
    doubts = _Doubts(som, service, incident)
    errors = predictor(ontology, som.sources)
    searched = []
    for output in service.sources:
        there = [s for s in som.sources if s.service.name != service.name]
        wishes = service.prefer, output.provision.fault_tolerant_error
        listing = substitutes(ontology, there, output.property, errors, *wishes)
        found = [
            _found(ontology, output, each.derivation, each.quality, error, doubts, incident)
            for each, error in islice(listing, LOOKED_AT)
        ]
        lost = Loss(output.property, output, tuple(there), ())
        searched.append(
            Searched(
                output.property,
                _first(found),
                next(listing, None) is None,
                tuple(dead_branches(ontology, lost)[:MOST_SHOWN]),
            )
        )
    return Search(tuple(searched), _answer(ontology, som, service, incident))


class _Doubts:
    """Reasons why sources could not be used in an incident."""

    def __init__(self, som: Som, service: Service, incident: Incident) -> None:
        self._service = service
        self._unavailable: FrozenSet[str] = frozenset(incident.unavailable)
        self._faulty = {incident.faulty_node, service.node} - {""}
        self._shared = {cause for causes in service.avoided for cause in causes}
        self._ran = set(incident.inputs)

    def of(self, source: Source) -> List[str]:
        """In words, for one source."""
        of, who = source.service, f"{source.path} ({source.service.name})"
        if not {self._service.name, *self._service.topics}.isdisjoint(of.upstream):
            return [f"{who} is computed from the lost service"]
        if of.node in self._faulty:
            return [f"{who} is published by the failed node {of.node}"]
        if of.name in self._unavailable:
            return [f"{who} was not available: it had failed, or nobody published it"]
        causes = [cause for cause in of.shared if cause in self._shared]
        if causes and source.path not in self._ran:
            return [f"{who} may fail with the lost service, by {', '.join(causes)}"]
        if of.node in self._service.avoid and source.path not in self._ran:
            return [f"{who} is of {of.node}, which the SOM avoids"]
        return []


def _found(
    ontology: Ontology,
    output: Source,
    derivation: Derivation,
    quality: float,
    error: Optional[Error],
    doubts: _Doubts,
    incident: Incident,
) -> Found:
    sources = derivation.sources()
    why_not = [why for source in sources for why in doubts.of(source)]
    too_wrong = refusal(error, output.provision.fault_tolerant_error)
    why_not += [too_wrong] if too_wrong else []
    try:
        program_of(ontology, [derivation], [output])
    except GenerationError as refused:
        why_not.append(f"it cannot be executed: {refused}")
    relations, inputs = derivation.relations(), tuple(source.path for source in sources)
    ran = not why_not and _is_part(relations, inputs, incident)
    return Found(relations, inputs, quality, error, tuple(why_not), ran)


def _is_part(relations: Tuple[str, ...], inputs: Tuple[str, ...], incident: Incident) -> bool:
    """Return whether it is what ran, or of several outputs a part of it."""
    if not incident.code:
        return False
    if len(incident.outputs) == 1:
        return set(relations) == set(incident.relations) and set(inputs) == set(incident.inputs)
    return set(relations) <= set(incident.relations) and set(inputs) <= set(incident.inputs)


def _first(found: List[Found]) -> Tuple[Found, ...]:
    """Return those that are told: what ran is among them, and each way to do it counts once."""
    seen: Set[Tuple[FrozenSet[str], FrozenSet[str]]] = set()
    told = []
    room = {True: MOST_SHOWN, False: MOST_SHOWN}
    for each in found:
        way, usable = (frozenset(each.relations), frozenset(each.inputs)), not each.why_not
        if each.ran or (way not in seen and room[usable]):
            told.append(each)
            room[usable] -= 1
        seen.add(way)
    return tuple(told)


def _answer(ontology: Ontology, som: Som, service: Service, incident: Incident) -> str:
    """Return in words what the search finds now for the whole service."""
    excluded = [incident.faulty_node, service.node, *incident.unavailable]
    table = SourceTable(ontology.network, som.sources)
    errors = predictor(ontology, som.sources)
    try:
        plan = plan_service(ontology, service, table, excluded, predictor=errors)
    except (NoSubstitute, GenerationError) as none:
        if incident.code:
            return f"By the models as they are now nothing would do: {none}. They have changed."
        return f"Nothing would do: {none}."
    by = ", ".join(plan.relations) or "the same property elsewhere"
    if plan.program.code == incident.code and plan.program.inputs == incident.inputs:
        return f"Searched again, the best is what ran: {by}."
    if not incident.code:
        return f"By the models as they are now there is a substitute, by {by}."
    return (
        f"Searched again, the best is another one: {by}. What ran may have been the next best "
        "after one that failed or whose law did not hold, or the models have changed since."
    )

"""The robot without a service or a node: healing's answers, its cut sets, and in words."""
from typing import Any, Dict, List, Mapping, Sequence, Tuple

from shsa_learning.fragility import Fragility
from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som

MOST_SERVICES = 20
"""Of a node; healing is asked about each, one after the other."""
MOST_CUTS = 50
MOST_TOLD = 3

Document = Dict[str, Any]
Cuts = Dict[Tuple[str, ...], List[str]]
"""Causes of failure, and which needed services are lost with all of them."""


def concerned(som: Som, service: str, node: str) -> Tuple[Service, ...]:
    """Return the services that the question is about. Raises ShsaError if there are none."""
    found = tuple(each for each in som if (each.name == service if service else each.node == node))
    if not found:
        what = f"service {service!a}" if service else f"node {node!a} that provides a service"
        raise ShsaError(f"there is no {what} in the SOM")
    return found[:MOST_SERVICES]


def cut_sets(ontology: Ontology, som: Som, node: str) -> Cuts:
    """Return the cut sets that a node is in: alone, or with one other cause of failure.

    With all causes of such a set a needed service is lost, and can be derived from nothing. What is
    lost without the node as well is none of its cut sets.
    """
    fragility = Fragility(ontology, som)
    left = fragility.after([node])
    found: Cuts = {}
    for service in som.may_be_needed():
        before = set(fragility.names(fragility.bits(service.properties)))
        if node in before:
            found.setdefault((node,), []).append(service.name)
            continue
        for other in fragility.names(fragility.bits(service.properties, left)):
            if other not in before and other != node:
                found.setdefault((node, other), []).append(service.name)
    order = sorted(found, key=lambda cut: (len(cut), cut))
    return {cut: found[cut] for cut in order[:MOST_CUTS]}


def answer(question: str, services: Sequence[Document], cuts: Cuts) -> Document:
    """Return the whole answer."""
    return {
        "question": question,
        "services": list(services),
        "cut_sets": [list(cut) for cut in cuts],
        "left": left(services, cuts),
    }


def left(services: Sequence[Mapping[str, Any]], cuts: Cuts) -> str:
    """Return in words what is left then."""
    parts = [_replaced(each) for each in services if each["found"]]
    parts += [_lost(each) for each in services if not each["found"]]
    pairs = [(cut[1], lost) for cut, lost in cuts.items() if len(cut) == 2]
    for other, lost in pairs[:MOST_TOLD]:
        parts.append(f"If {other} failed as well, {_and(lost)} could not be healed.")
    if len(pairs) > MOST_TOLD:
        parts.append(f"{len(pairs) - MOST_TOLD} more such pairs are in the cut sets.")
    if not cuts:
        parts.append("After it any one more failure could be healed.")
    return " ".join(parts)


def _replaced(each: Mapping[str, Any]) -> str:
    relations = ", ".join(each["relations"])
    by = f"computed by {relations}" if relations else "passed on from another service"
    quality = "" if each["quality"] is None else f", quality {each['quality']:.2g}"
    return f"{each['service']} would be {by}{quality}."


def _lost(each: Mapping[str, Any]) -> str:
    missing = ", ".join(each["missing"])
    why = f"missing: {missing}" if missing else each["detail"].rstrip(".")
    return f"{each['service']} could not be healed ({why})."


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))

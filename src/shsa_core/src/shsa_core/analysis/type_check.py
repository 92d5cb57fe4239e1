"""Finds what of a SOM cannot be read or written on this computer, by its message types."""
from dataclasses import replace
from typing import List, NamedTuple, Tuple

from shsa_core import message_types
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.field_value import problem
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som


class Problem(NamedTuple):
    """Something that cannot be used; `needed`: it would have to be healed."""

    text: str
    needed: bool


def mark_unusable(som: Som) -> Tuple[Som, List[Problem]]:
    """Return the SOM with a mark at all that cannot be used here, and what that is.

    What is not marked is used and healed as ever.
    """
    problems: List[Problem] = []
    som = with_unknowns(som, message_types.layout)
    return som.with_services(_marked(service, problems) for service in som), problems


def _marked(service: Service, problems: List[Problem]) -> Service:
    provides: List[Provision] = []
    unwritable = ""
    for each in service.provides:
        unreadable = problem(service.type, each.field, False)
        unwritable = unwritable or problem(service.type, each.field, True)
        provides.append(replace(each, unreadable=unreadable))
        if unreadable:
            text = f"{service.name}: {each.property} is not read: {unreadable}"
            problems.append(Problem(text, needed=False))
    if service.needed and service.policy.plans and unwritable:
        text = f"{service.name} is needed, and cannot be substituted: {unwritable}"
        problems.append(Problem(text, needed=True))
    return replace(service, provides=tuple(provides), unwritable=unwritable)

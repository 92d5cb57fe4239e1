"""What of a SOM can be read and written here: its message types may not be built."""
import dataclasses
from typing import List, NamedTuple, Tuple

from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.ros.messages.fields import problem


class Problem(NamedTuple):
    """What cannot be used, and whether somebody needs it, so that it would be healed."""

    text: str
    needed: bool


def mark_unusable(som: Som) -> Tuple[Som, List[Problem]]:
    """The SOM with a mark at all that cannot be used here, and what that is.

    What is not marked is used and healed as ever.
    """
    problems: List[Problem] = []
    return som.with_services(_marked(service, problems) for service in som), problems


def _marked(service: Service, problems: List[Problem]) -> Service:
    provides: List[Provision] = []
    unwritable = ""
    for each in service.provides:
        unreadable = problem(service.type, each.field, False)
        unwritable = unwritable or problem(service.type, each.field, True)
        provides.append(dataclasses.replace(each, unreadable=unreadable))
        if unreadable:
            text = f"{service.name}: {each.property} is not read: {unreadable}"
            problems.append(Problem(text, needed=False))
    if service.needed and service.policy.plans and unwritable:
        text = f"{service.name} is needed, and cannot be substituted: {unwritable}"
        problems.append(Problem(text, needed=True))
    return dataclasses.replace(service, provides=tuple(provides), unwritable=unwritable)

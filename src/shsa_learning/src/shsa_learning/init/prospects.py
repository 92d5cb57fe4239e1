"""Tells of a draft by which nothing can be healed what is in the way."""
from typing import List

from shsa_core.errors import GenerationError, NoSubstitute, listed
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_learning.schedulability import takeovers

MOST_SERVICES = 20


def obstacles(ontology: Ontology, som: Som) -> List[str]:
    """Return what is in the way of each service, in lines; nothing if one can be healed."""
    plan_of = takeovers(ontology, som.sources)
    lines: List[str] = []
    for service in som:
        try:
            plan_of(service)
        except NoSubstitute as none:
            names = none.in_the_way or none.properties
            lines.append(f"  {service.name}: no relation yields {listed(names)}")
        except GenerationError as error:
            lines.append(f"  {service.name}: {error}")
        else:
            return []
    more = len(lines) - MOST_SERVICES
    lines[MOST_SERVICES:] = [f"  and {more} more services"] if more > 0 else []
    return ["Nothing can be healed by this yet. In the way:", *lines] if lines else []

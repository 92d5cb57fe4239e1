"""Finds what makes a model invalid, or cannot be read or written on this computer."""
from dataclasses import replace
from typing import Iterator, List, Tuple

from shsa_core import message_types
from shsa_core.codegen.generator import generate_function
from shsa_core.errors import GenerationError, ModelError
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.field_value import problem
from shsa_core.model.log import Level, Log
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som


def function_errors(ontology: Ontology) -> Iterator[ModelError]:
    """Yield an error for each function of an ontology of which no code can be generated."""
    for function in ontology.functions:
        try:
            if function.law is not None:
                generate_function(function, ontology.constants)
        except GenerationError as error:
            yield ModelError(function.where, str(error))


def name_errors(ontology: Ontology, som: Som) -> Iterator[ModelError]:
    """Yield an error for each value of a SOM that is no property of the ontology."""
    for source in som.sources:
        if source.property not in ontology.properties:
            kind = "is a constant" if source.property in ontology.constants else "is not"
            what = f"{source.service.name} provides '{source.property}', which {kind} in the"
            yield ModelError(source.provision.where, f"{what} ontology")


def mark_unusable(som: Som) -> Tuple[Som, List[Log]]:
    """Return the SOM with a mark at all that cannot be used here, and what that is.

    What is not marked is used and healed as ever; an error is what would have to be healed.
    """
    problems: List[Log] = []
    som = with_unknowns(som, message_types.layout)
    return som.with_services(_marked(service, problems) for service in som), problems


def _marked(service: Service, problems: List[Log]) -> Service:
    provides: List[Provision] = []
    unwritable = ""
    for each in service.provides:
        unreadable = problem(service.type, each.field, False)
        unwritable = unwritable or problem(service.type, each.field, True)
        provides.append(replace(each, unreadable=unreadable))
        if unreadable:
            text = f"{service.name}: {each.property} is not read: {unreadable}"
            problems.append(Log(Level.WARN, text))
    if service.needed and service.policy.plans and unwritable:
        text = f"{service.name} is needed, and cannot be substituted: {unwritable}"
        problems.append(Log(Level.ERROR, text))
    return replace(service, provides=tuple(provides), unwritable=unwritable)

"""The elements of the drawn ontology, by the ids that page and document share."""
from typing import Collection, Dict, Iterable, List

from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som


def property_id(name: str) -> str:
    """Return the id of a property."""
    return f"property-{name}"


def service_id(name: str) -> str:
    """Return the id of a service."""
    return f"service-{name}"


def relation_id(relation: str, output: str) -> str:
    """Return the id of the direction of a relation that yields a property."""
    return f"relation-{relation}-{output}"


def elements(
    ontology: Ontology,
    som: Som,
    lost: Iterable[str],
    relations: Collection[str],
    inputs: Collection[str],
) -> List[str]:
    """Return the elements by which a substitute computes lost properties, its inputs first.

    `relations` are the names of those that it uses, `inputs` the paths that it reads.
    """
    found: Dict[str, None] = {}
    open_ = list(lost)
    while open_:
        name = open_.pop(0)
        if property_id(name) in found:
            continue
        found[property_id(name)] = None
        read = [source for source in som.of_property(name) if source.path in inputs]
        found.update({service_id(source.service.name): None for source in read})
        for function in () if read else ontology.functions_for(name):
            if function.relation in relations:
                found[relation_id(function.relation, name)] = None
                open_ += function.inputs
    return list(found)

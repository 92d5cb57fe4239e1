"""A learned model as a relation of an ontology."""
from dataclasses import replace
from typing import Dict, Optional

from shsa_core.language.expression import parse_constraint
from shsa_core.model.error import Error, quality_of
from shsa_core.model.ontology import Ontology, Property, TransferFunction
from shsa_learning.learn.learner import Learned

FIGURES, DIGITS = ("rms", "bias", "p95", "delay", "baseline"), 4


def relation_of(learned: Learned) -> TransferFunction:
    """Return the relation that was learned, with its error and where it holds.

    A law that was the best keeps its text and gets its error.
    """
    model, error = learned.model, learned.error
    assert model is not None and error is not None
    source = f"{error.source}; {model.name} from {', '.join(model.inputs)}"
    known = _short(replace(error, source=source))
    relation = replace(model.relation, error=known, quality=quality_of(known))
    if not model.constraint:
        return relation
    return replace(relation, constraint=parse_constraint(model.constraint))


def with_relation(ontology: Ontology, relation: TransferFunction) -> Ontology:
    """Return the ontology with the relation, instead of one of its name.

    A property that is not there is added; its unit is not known.
    """
    properties: Dict[str, Property] = dict(ontology.properties)
    for name in (relation.output, *relation.inputs):
        properties.setdefault(name, Property(name))
    own = (relation.relation, relation.output)
    others = [f for f in ontology.functions if (f.relation, f.output) != own]
    functions = [relation if (f.relation, f.output) == own else f for f in ontology.functions]
    return Ontology(
        properties,
        ontology.constants,
        tuple(functions) if len(others) < len(functions) else (*functions, relation),
    )


def _short(error: Error) -> Error:
    """Return the error with as many digits as mean something."""
    figures = {name: _digits(getattr(error, name)) for name in FIGURES}
    return replace(error, **figures)


def _digits(value: Optional[float]) -> Optional[float]:
    return None if value is None else float(f"{value:.{DIGITS}g}")

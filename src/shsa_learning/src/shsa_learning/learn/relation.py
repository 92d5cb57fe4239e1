"""A learned model as a relation of an ontology."""
from dataclasses import replace
from typing import Dict, Optional

from shsa_core.language.expression import parse_constraint, parse_law
from shsa_core.model.error import Error, quality_of
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.relation import TransferFunction
from shsa_learning.learn.evaluation import LEARNED, check_agreement
from shsa_learning.learn.learner import Learned
from shsa_learning.learn.table import Table

FIGURES, DIGITS = ("rms", "bias", "p95", "delay", "baseline"), 4


def relation_of(learned: Learned, table: Table) -> TransferFunction:
    """Return the relation: as generated code it gives what was fitted, on the rows of the table.

    A law that was the best keeps its text and gets its error. Raises ModelError if the generated
    code gives anything else, ExpressionError if the function is too long for the language.
    """
    model, error = learned.model, learned.error
    assert model is not None and error is not None
    source = f"{error.source}; {model.choice.recipe} from {', '.join(model.inputs)}"
    known = _short(replace(error, source=source))
    if model.law is not None:
        return replace(model.law.function, error=known, quality=quality_of(known))
    relation = TransferFunction(
        LEARNED + learned.target,
        learned.target,
        model.inputs,
        parse_law(model.function),
        quality_of(known),
        parse_constraint(model.constraint),
        model.function,
        error=known,
    )
    check_agreement(replace(relation, constraint=None), {}, table, model.predict(table))
    return relation


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

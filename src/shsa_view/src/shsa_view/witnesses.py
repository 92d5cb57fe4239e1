"""Values that relations compute from the newest ones of other services: witnesses."""
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from shsa_core.codegen.generator import generate_function
from shsa_core.codegen.program import compile_steady
from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_view.graph import functions_for

MOST_RELATIONS = 5
"""Of a property."""

Values = Mapping[str, float]
Step = Callable[[Sequence[float], float], Optional[Tuple[float, ...]]]


class Witness(NamedTuple):
    """A relation that yields a property, from inputs by name."""

    relation: str
    inputs: Tuple[str, ...]
    step: Step


class WitnessTable:
    """The relations of each property that services provide; those that remember are left out."""

    def __init__(self, ontology: Ontology, som: Som) -> None:
        names = dict.fromkeys(source.property for source in som.sources)
        self._of = {name: _witnesses(ontology, name) for name in names}

    def values(self, own: Sequence[str], known: Values) -> Dict[str, Dict[str, float]]:
        """Return what relations say of the properties of a service, by these newest values.

        A relation that uses one of the service's own values is no witness.
        """
        told: Dict[str, Dict[str, float]] = {}
        for name in own:
            for each in self._of.get(name, ()):
                if all(part in known and part not in own for part in each.inputs):
                    found = each.step([known[part] for part in each.inputs], 0.0)
                    if found is not None:
                        told.setdefault(name, {})[each.relation] = found[0]
        return told


def _witnesses(ontology: Ontology, name: str) -> List[Witness]:
    found: List[Witness] = []
    for function in functions_for(ontology, name)[:MOST_RELATIONS]:
        try:
            program = generate_function(function, ontology.constants)
            step = compile_steady(program.code, len(program.inputs), 1)
        except ShsaError:
            continue  # healing names what is wrong with it
        if step is not None:
            inputs = tuple(path.rpartition("/")[2] for path in program.inputs)
            found.append(Witness(function.relation, inputs, step))
    return found

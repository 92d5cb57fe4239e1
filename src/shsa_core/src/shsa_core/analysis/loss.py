"""What is left when a property is lost, by the SOM alone: without a running graph."""
from collections import deque
from typing import Iterable, List, NamedTuple, Tuple

from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.model.som import Som
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import LOST, SourceTable


class Loss(NamedTuple):
    """A lost property: its lost sources, those that stay, and what must not be used."""

    name: str
    lost: Tuple[Source, ...]
    available: Tuple[Source, ...]
    excluded: Tuple[str, ...]

    @property
    def output(self) -> str:
        """Topic and field that a substitute would fill.

        The property's name if nothing provides it.
        """
        return self.lost[0].path if self.lost else self.name


def lose(som: Som, name: str, without: Iterable[str] = ()) -> Loss:
    """The loss of the property `name`: of its needed sources, or its first one if none is needed.

    What their services and nodes provide, and the services, topics and nodes in `without`, are lost
    with it.
    """
    own = som.of_property(name)
    lost = tuple(source for source in own if source.service.needed) or own[:1]
    excluded = dict.fromkeys([*(s.service.name for s in lost), *(s.node for s in lost), *without])
    available = [s for s in som.sources if excluded.keys().isdisjoint(s.names)]
    return Loss(name, lost, tuple(available), tuple(excluded))


class DeadBranch(NamedTuple):
    """A relation that cannot yield a property, and the inputs that it lacks."""

    relation: str
    output: str
    lacking: Tuple[str, ...]


def dead_branches(ontology: Ontology, loss: Loss) -> List[DeadBranch]:
    """The relations within reach of the lost property that cannot be used, nearest first."""
    network = ontology.network
    target = network.number(loss.name)
    best = BestDerivations(network, SourceTable(network, loss.available), prune=False)
    best.settle(target)
    dead = []
    near = deque([target])
    seen = {target}
    while near:
        number = near.popleft()
        for function in network.functions_of(number):
            inputs = network.inputs_of(function)
            lacking = [i for i in inputs if i == target or best.ratings[i] == LOST]
            if lacking:
                names = tuple(network.names[i] for i in lacking)
                dead.append(
                    DeadBranch(network.functions[function].relation, network.names[number], names)
                )
            near.extend(i for i in inputs if i not in seen)
            seen.update(inputs)
    return dead

"""What is left when a property is lost, by the SOM alone: without a running graph."""
from collections import deque
from typing import Iterable, List, NamedTuple, Tuple

from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Service, Som
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import LOST, ServiceTable


class Loss(NamedTuple):
    """A lost property: the services that are lost with it, those that stay, and what must not be used."""

    name: str
    lost: Tuple[Service, ...]
    available: Tuple[Service, ...]
    excluded: Tuple[str, ...]

    @property
    def output(self) -> str:
        """Topic and field that a substitute would fill; the property's name if no service provides it."""
        return self.lost[0].path if self.lost else self.name


def lose(som: Som, name: str, without: Iterable[str] = ()) -> Loss:
    """The loss of the property `name`: of its needed services, or its first one if none is needed.

    What the nodes of these services provide, and the nodes and topics in `without`, are lost with it.
    """
    own = som.of_property(name)
    lost = tuple(service for service in own if service.needed) or own[:1]
    excluded = dict.fromkeys([*(s.topic for s in lost), *(s.node for s in lost), *without])
    available = [s for s in som if s.node not in excluded and s.topic not in excluded]
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
    best = BestDerivations(network, ServiceTable(network, loss.available), prune=False)
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

"""Finds what is left when a property is lost, by the SOM alone: without a running graph."""
from collections import deque
from dataclasses import replace
from typing import Collection, Iterable, Iterator, List, NamedTuple, Optional, Tuple

from shsa_core.codegen.prediction import Predictor
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.model.som import Som
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import LOST, SourceTable
from shsa_learning.substitutes import Substitute, substitutes


class Loss(NamedTuple):
    """A lost property: its lost source, those that stay, and what must not be used.

    `source` is None where nothing provides it. `avoided`: the sources that its substitute reads
    only if nothing else is left, as the SOM wishes.
    """

    name: str
    source: Optional[Source]
    available: Tuple[Source, ...]
    excluded: Tuple[str, ...]
    avoided: Tuple[Source, ...] = ()

    @property
    def prefer(self) -> Tuple[str, ...]:
        """The relations that its substitute should be computed by."""
        return () if self.source is None else self.source.service.prefer

    @property
    def limit(self) -> Optional[float]:
        """Return what the error of its substitute must be within; None: that is not said."""
        return None if self.source is None else self.source.provision.fault_tolerant_error

    def apart(self, unavoided: Collection[str] = ()) -> "Loss":
        """Return the loss without what shares a cause with the lost service, or is to be avoided.

        `unavoided`: causes that its substitute shares, as nothing else would do.
        """
        assert self.source is not None
        service = self.source.service
        causes = next((each for each in service.avoided if set(each).isdisjoint(unavoided)), ())
        shared = set(causes) - set(service.avoid)
        left = [s for s in self.available if shared.isdisjoint(s.names)]
        avoided = tuple(s for s in left if not set(causes).isdisjoint(s.names))
        return self._replace(
            available=tuple(s for s in left if s not in avoided),
            excluded=(*self.excluded, *causes),
            avoided=avoided,
        )


def lose(som: Som, name: str, without: Iterable[str] = ()) -> Tuple[Loss, ...]:
    """Return the losses of a property: by each needed service, or its first if none is needed.

    What this service and its node provide, and the services, topics, nodes and causes in `without`,
    are lost with it; other services of the property stay.
    """
    own = som.of_property(name)
    lost = tuple(source for source in own if source.service.needed) or own[:1]
    if not lost:
        return (_loss(som, name, None, without),)
    return tuple(
        _loss(som, name, source, [source.service.name, source.node, *without]) for source in lost
    )


def _loss(som: Som, name: str, source: Optional[Source], excluded: Iterable[str]) -> Loss:
    names = tuple(dict.fromkeys(excluded))
    available = tuple(s for s in som.sources if set(names).isdisjoint(s.names))
    return Loss(name, source, available, names)


def ranked(
    ontology: Ontology, loss: Loss, predictor: Optional[Predictor]
) -> Iterator[Tuple[Substitute, Optional[Error]]]:
    """Yield every substitute of a lost property, best first; those by avoided sources last."""
    question = loss.name, predictor, loss.prefer, loss.limit
    first = True
    for each in substitutes(ontology, loss.available, *question):
        first = False
        yield each
    if loss.avoided:
        for found, error in substitutes(ontology, (*loss.available, *loss.avoided), *question):
            if not set(loss.avoided).isdisjoint(found.derivation.sources()):
                yield replace(found, proven_best=found.proven_best and first), error


class DeadBranch(NamedTuple):
    """A relation that cannot yield a property, and the inputs that it lacks."""

    relation: str
    output: str
    lacking: Tuple[str, ...]


def dead_branches(ontology: Ontology, loss: Loss) -> List[DeadBranch]:
    """Return the relations in reach of the lost property that cannot be used, nearest first."""
    network = ontology.network
    target = network.number(loss.name)
    table = SourceTable(network, (*loss.available, *loss.avoided))
    best = BestDerivations(table, prune=False)
    best.settle(target)
    dead = []
    near = deque([target])
    seen = {target}
    while near:
        number = near.popleft()
        for function in network.functions_of[number]:
            inputs = network.inputs[function]
            lacking = [i for i in inputs if i == target or best.ratings[i] == LOST]
            if lacking:
                names = tuple(network.names[i] for i in lacking)
                dead.append(
                    DeadBranch(network.functions[function].relation, network.names[number], names)
                )
            near.extend(i for i in inputs if i not in seen)
            seen.update(inputs)
    return dead

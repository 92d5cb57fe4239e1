"""Finds the failures that a property does not survive, for all nodes and common causes at once."""
from contextlib import contextmanager
from typing import Any, Dict, Iterable, Iterator, List, Optional, Sequence, Set, Tuple

import networkx as nx

from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.search.best import dependents

AS_IT_IS = 1
"""The bit of what is lost already, whatever else fails; each bit above it stands for one cause."""


class Fragility:
    """The causes that each property cannot be derived without, as bits of a number.

    A cause is a node, or what services fail with. A source is lost with any of its causes, a
    function with any of its inputs, a property with all of its sources and functions. All begin
    as lost and are regained until nothing changes: what depends on itself alone stays lost.
    Functions that cannot be executed do not count.
    """

    def __init__(self, ontology: Ontology, som: Som) -> None:
        network = ontology.network
        self.causes = tuple(sorted({cause for service in som for cause in service.causes}))
        self._bits = {cause: AS_IT_IS << place for place, cause in enumerate(self.causes, 1)}
        self._number = network.number
        self._names = network.names
        self._measured: Dict[int, List[int]] = {}
        self._measures: Dict[str, List[int]] = {}
        for source in som.sources:
            number = network.number(source.property)
            self._measured.setdefault(number, []).append(self.bit(*source.service.causes))
            for cause in source.service.causes:
                self._measures.setdefault(cause, []).append(number)
        self._functions: Dict[int, List[Sequence[int]]] = {}
        self._users: Dict[int, Set[int]] = {}
        for f, function in enumerate(network.functions):
            if function.law is not None:
                self._functions.setdefault(network.outputs[f], []).append(network.inputs[f])
                for input_ in network.inputs[f]:
                    self._users.setdefault(input_, set()).add(network.outputs[f])
        # In this order most inputs stand before what is derived from them.
        nodes = nx.dfs_postorder_nodes(ontology.graph.reverse())
        named = [network.number(node) for node in nodes if isinstance(node, str)]
        self._order = [*named, *range(len(named), len(network.names))]
        everything = (AS_IT_IS << (len(self.causes) + 1)) - 1
        self._lost = dict.fromkeys(self._order, everything)
        self._everything = everything
        self._regain(self._order, self._lost, failed=0)

    @contextmanager
    def remedied(self, output: str, input_: Optional[str]) -> Iterator[None]:
        """Add an independent node that measures a property, or a relation for it from `input_`.

        Only what this regains is worked out anew: the more there is, the less is lost.
        """
        number, lost = self._number(output), self._lost
        more: List[Any] = self._measured.setdefault(number, [])
        if input_ is None:
            more.append(0)
        else:
            more = self._functions.setdefault(number, [])
            more.append([self._number(input_)])
            users = self._users.setdefault(self._number(input_), set())
            known = number in users
            users.add(number)
        self._lost = lost.copy()
        self._spread(number, self._lost)
        try:
            yield
        finally:
            self._lost = lost
            more.pop()
            if input_ is not None and not known:
                users.remove(number)

    def after(self, failed: Iterable[str]) -> Dict[int, int]:
        """Map each property's number to its bits once some causes have failed."""
        causes = tuple(failed)
        touched = dependents(self._users, (n for cause in causes for n in self._measures[cause]))
        lost = self._lost.copy()
        lost.update(dict.fromkeys(touched, self._everything))
        order = [number for number in self._order if number in touched]
        self._regain(order, lost, self.bit(*causes))
        return lost

    def names(self, bits: int) -> Tuple[str, ...]:
        """Return the causes that bits stand for."""
        return tuple(cause for cause in self.causes if self._bits[cause] & bits)

    def bits(self, names: Iterable[str], lost: Optional[Dict[int, int]] = None) -> int:
        """Return the bits of several properties together: one lost is all lost.

        `lost`: as `after` returns it; None: as it is.
        """
        together = 0
        for name in names:
            together |= (self._lost if lost is None else lost)[self._number(name)]
        return together

    def ancestors(self, names: Iterable[str]) -> List[str]:
        """Return some properties and all that they can be derived from, in order of the network."""
        inputs = {n: [i for each in of for i in each] for n, of in self._functions.items()}
        found = dependents(inputs, map(self._number, names))
        return [name for number, name in enumerate(self._names) if number in found]

    def bit(self, *causes: str) -> int:
        """Return the bits of some causes."""
        together = 0
        for cause in causes:
            together |= self._bits[cause]
        return together

    def _regain(self, order: Sequence[int], lost: Dict[int, int], failed: int) -> None:
        stale = set(order)
        while stale:
            for number in order:
                if number in stale:
                    stale.remove(number)
                    bits = self._bits_of(number, lost, failed)
                    if bits != lost[number]:
                        lost[number] = bits
                        stale.update(self._users.get(number, ()))
            order = order[::-1]  # a law of several directions hands on in both

    def _spread(self, number: int, lost: Dict[int, int]) -> None:
        """Update all that is derived from a property that has regained something."""
        stale = {number: None}
        while stale:
            number = next(iter(stale))
            del stale[number]
            bits = self._bits_of(number, lost, failed=0)
            if bits != lost[number]:
                lost[number] = bits
                stale.update(dict.fromkeys(self._users.get(number, ())))

    def _bits_of(self, number: int, lost: Dict[int, int], failed: int) -> int:
        bits = lost[number]
        for causes in self._measured.get(number, ()):
            if not causes & failed:
                bits &= causes
        for inputs in self._functions.get(number, ()):
            needed = 0
            for input_ in inputs:
                needed |= lost[input_]
            bits &= needed
        return bits

"""The plans that are made before they are needed."""
from typing import Callable, Collection, Dict, FrozenSet, List, Optional, Set, Tuple, Union

import networkx as nx

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.search.derivation import SourceTable


class PlanTable:
    """For every needed service the plan for the case that its node has failed.

    `change` says which services there are and drops the answers that this may change; `step` makes
    one of those anew, and is called while nothing else is to do. A plan that is in the table is the
    one that a search would give now; an error tells that there is none, though more may be missing
    by now. `sources` has what may be used; `make` searches a plan without some nodes.
    """

    def __init__(
        self,
        ontology: Ontology,
        needed: Collection[Service],
        make: Callable[[Service, FrozenSet[str]], Plan],
    ) -> None:
        self.sources = SourceTable(ontology.network)
        self._ontology = ontology
        self._make = make
        self._needed: Dict[str, Service] = {}
        self._stale: Dict[str, None] = {}
        self._publishers: Dict[str, str] = {}  # the node that published a service last
        self._answers: Dict[str, Union[Plan, ShsaError]] = {}
        self._avoided: Dict[str, FrozenSet[str]] = {}  # the nodes that an answer does without
        # Services that went, and whose answers were made since.
        self._gone: Dict[str, Tuple[Service, Set[str]]] = {}
        self._readers: Dict[str, Set[str]] = {}  # the services whose plan reads a service
        for service in needed:
            self.serve(service)

    @property
    def stale(self) -> bool:
        """Tell that there is an answer to be made."""
        return bool(self._stale)

    def serve(self, service: Service) -> None:
        """Make plans for a service if it is needed; it may have been another before."""
        self.forget(service.name)
        if service.needed:
            self._needed[service.name] = service
            self._stale[service.name] = None

    def forget(self, name: str) -> None:
        """Make no more plans for a service."""
        self.drop(name)
        self._stale.pop(name, None)
        self._needed.pop(name, None)

    def change(self, gone: Collection[Service], come: Collection[Service]) -> None:
        """Note that some services are available no more, and some are now."""
        for source in (each for service in gone for each in service.readable):
            self.sources.discard(source)
        for source in (each for service in come for each in service.readable):
            self.sources.add(source)
        self._publishers.update({service.name: service.node for service in come})
        read = {name for service in gone for name in self._readers.get(service.name, ())}
        for name in (*sorted(read), *self._improved(come)):
            self.drop(name)
        self._gone.update({service.name: (service, set()) for service in gone})
        for name in (each.name for each in come):
            if name in self._answers and self.to_avoid(name) != self._avoided[name]:
                self.drop(name)

    def step(self) -> Optional[str]:
        """Make one answer anew. Returns its service, None if all are there."""
        name = next(iter(self._stale), None)
        if name is None:
            return None
        del self._stale[name]
        avoided = self.to_avoid(name)
        try:
            plan = self._make(self._needed[name], avoided)
            self._answers[name] = plan
            for source in plan.inputs:
                self._readers.setdefault(source.service.name, set()).add(name)
        except ShsaError as error:
            self._answers[name] = error
        self._avoided[name] = avoided
        for _, made in self._gone.values():
            made.add(name)
        return name

    def plan(self, name: str) -> Optional[Plan]:
        """Return the plan for a service; None if it is to be searched for, or there is none."""
        answer = self._answers.get(name)
        return answer if isinstance(answer, Plan) else None

    def hopeless(self, name: str, excluded: Collection[str]) -> bool:
        """Tell that a service is known to have no plan without some nodes."""
        known = isinstance(self._answers.get(name), ShsaError)
        return known and self._avoided[name] <= set(excluded)

    def to_avoid(self, name: str) -> FrozenSet[str]:
        """Return the nodes that are to publish a service, or did last."""
        return frozenset({self._needed[name].node, self._publishers.get(name, "")} - {""})

    def _improved(self, come: Collection[Service]) -> List[str]:
        """Return the services whose answer may be a better plan now."""
        graph, found = self._ontology.graph, set()
        reached: Set[str] = set()  # the properties that are derived from what has come
        for service in come:
            gone = self._gone.pop(service.name, None)
            if gone and gone[0] == service:  # then it concerns only whose plan was made meanwhile
                found |= gone[1]
                continue
            for name in set(service.properties) - reached if self._answers else ():
                reached |= {name, *(nx.descendants(graph, name) if name in graph else ())}
        for name in self._answers if reached else ():
            if not reached.isdisjoint(self._needed[name].properties):
                found.add(name)
        return sorted(found)

    def drop(self, name: str) -> None:
        """Make the answer for a service anew, if there is one."""
        answer = self._answers.pop(name, None)
        if answer is not None:
            self._stale[name] = None
        if isinstance(answer, Plan):
            for source in answer.inputs:
                self._readers[source.service.name].discard(name)

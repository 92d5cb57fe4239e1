"""The plans that are made before they are needed."""
from typing import Callable, Dict, FrozenSet, Iterable, List, Optional, Set, Tuple, Union

from shsa_core.codegen.prediction import Predictor
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.search.derivation import SourceTable


class PlanTable:
    """For every needed service the plan for the case that its node has failed.

    `change` says which services there are and drops the answers that this may change; `step` makes
    one of those anew, and is called while nothing else is to do. A plan that is in the table is the
    one that a search would give now; an error tells that there is none, though more may be missing
    by now. `sources` has what may be used; `predictor` gives who predicts errors of a service.
    """

    def __init__(
        self,
        ontology: Ontology,
        needed: Iterable[Service],
        method: str,
        predictor: Callable[[str], Optional[Predictor]] = lambda service: None,
    ) -> None:
        self.sources = SourceTable(ontology.network)
        self._ontology = ontology
        self._method = method
        self._predictor = predictor
        self._needed: Dict[str, Service] = {}
        self._stale: Dict[str, None] = {}
        self._publishers: Dict[str, str] = {}  # the node that published a service last
        self._answers: Dict[str, Union[Plan, ShsaError]] = {}
        self._avoided: Dict[str, FrozenSet[str]] = {}  # the nodes that an answer does without
        # Services that went, and whose answers were made since.
        self._gone: Dict[str, Tuple[Service, Set[str]]] = {}
        self._readers: Dict[str, Set[str]] = {}  # the services whose plan reads a service
        self._of_property: Dict[int, Set[str]] = {}  # the needed services of a property
        self._users: Dict[int, List[int]] = {}  # the properties that are derived from a property
        network = ontology.network
        for function, output in enumerate(network.outputs):
            for input_ in network.inputs[function]:
                self._users.setdefault(input_, []).append(output)
        for service in needed:
            self.serve(service)

    @property
    def stale(self) -> bool:
        """Tell that there is an answer to be made."""
        return bool(self._stale)

    def serve(self, service: Service) -> None:
        """Make plans for a needed service, which may have been another before."""
        self.forget(service.name)
        self._needed[service.name] = service
        self._stale[service.name] = None
        for name in service.properties:
            number = self._ontology.network.number(name)
            self._of_property.setdefault(number, set()).add(service.name)

    def forget(self, name: str) -> None:
        """Make no more plans for a service."""
        self.drop(name)
        self._stale.pop(name, None)
        old = self._needed.pop(name, None)
        for property_ in old.properties if old else ():
            self._of_property[self._ontology.network.number(property_)].discard(name)

    def change(self, gone: Iterable[Service], come: Iterable[Service]) -> None:
        """Note that some services are available no more, and some are now."""
        gone, come = tuple(gone), tuple(come)
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
        avoided, service = self.to_avoid(name), self._needed[name]
        try:
            question = self._ontology, service, self.sources, avoided, self._method
            plan = plan_service(*question, predictor=self._predictor(name))
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

    def hopeless(self, name: str, excluded: Iterable[str]) -> bool:
        """Tell that a service is known to have no plan without some nodes."""
        known = isinstance(self._answers.get(name), ShsaError)
        return known and self._avoided[name] <= set(excluded)

    def to_avoid(self, name: str) -> FrozenSet[str]:
        """Return the nodes that are to publish a service, or did last."""
        nodes = {self._needed[name].node, self._publishers.get(name, "")}
        return frozenset(nodes - {""})

    def _improved(self, come: Iterable[Service]) -> List[str]:
        """Return the needed services that may have a better plan now."""
        found: List[str] = []
        new: List[Service] = []
        for service in come:
            gone = self._gone.pop(service.name, None)
            if gone and gone[0] == service:  # then it concerns only whose plan was made meanwhile
                found += sorted(gone[1])
            else:
                new.append(service)
        return found + self._derived_from(new)

    def _derived_from(self, services: Iterable[Service]) -> List[str]:
        """Return the needed services of properties that are derived from what services provide."""
        numbers = [self._ontology.network.number(p) for s in services for p in s.properties]
        stack = list(dict.fromkeys(numbers))
        seen = set(stack)
        found: Dict[str, None] = {}
        while stack:
            number = stack.pop()
            found.update(dict.fromkeys(sorted(self._of_property.get(number, ()))))
            for output in self._users.get(number, ()):
                if output not in seen:
                    seen.add(output)
                    stack.append(output)
        return list(found)

    def drop(self, name: str) -> None:
        """Make the answer for a service anew, if there is one."""
        answer = self._answers.pop(name, None)
        if answer is not None:
            self._stale[name] = None
        if isinstance(answer, Plan):
            for source in answer.inputs:
                self._readers[source.service.name].discard(name)

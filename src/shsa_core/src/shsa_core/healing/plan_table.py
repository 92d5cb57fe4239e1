"""Plans made before they are asked for, and kept up as services come and go."""
from typing import (
    AbstractSet,
    Collection,
    Dict,
    FrozenSet,
    Iterable,
    List,
    Optional,
    Set,
    Tuple,
    Union,
)

from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Service, Som


class PlanTable:
    """For every needed topic the plan for the case that its node has failed, made before it is asked for.

    `update` says which services there are and drops the answers that this may change; `step` makes one of those
    anew, and is called while nothing else is to do. An answer that is in the table is the one that a search would
    give now.
    """

    def __init__(self, ontology: Ontology, som: Som, method: str = "best") -> None:
        self._ontology = ontology
        self._som = som
        self._method = method
        self.available: FrozenSet[Service] = frozenset()
        self._nodes: Dict[str, Set[str]] = {}  # the nodes that publish a topic now
        self._answers: Dict[str, Union[TopicPlan, ShsaError]] = {}
        self._avoided: Dict[
            str, FrozenSet[str]
        ] = {}  # the topic and nodes that an answer does without
        self._uses: Dict[Service, Set[str]] = {}  # the topics whose plan reads a service
        network = ontology.network
        self._properties = {
            topic: {network.number(service.property) for service in som.of_topic(topic)}
            for topic in dict.fromkeys(service.topic for service in som if service.needed)
        }
        self._users: Dict[int, List[int]] = {}  # the properties that are derived from a property
        for function, output in enumerate(network.outputs):
            for input_ in network.inputs_of(function):
                self._users.setdefault(input_, []).append(output)

    @property
    def stale(self) -> Tuple[str, ...]:
        """The needed topics whose answer is to be made."""
        return tuple(topic for topic in self._properties if topic not in self._answers)

    def update(self, available: Iterable[Service]) -> None:
        """Takes over which services are available now."""
        now = frozenset(available)
        gone, come = self.available - now, now - self.available
        self.available = now
        self._nodes = {}
        for service in now:
            self._nodes.setdefault(service.topic, set()).add(service.node)
        for service in gone:
            for topic in tuple(self._uses.get(service, ())):
                self._drop(topic)
        for topic in self._derived_from(come):
            self._drop(topic)  # there may be a better plan
        for topic in self._derived_from(gone):
            if isinstance(self._answers.get(topic), ShsaError):
                self._drop(topic)  # there may be more missing
        for topic in tuple(self._answers):
            if not self._to_avoid(topic) <= self._avoided[topic]:
                self._drop(topic)

    def step(self) -> Optional[str]:
        """Makes one answer anew. Returns its topic, None if all are there."""
        topic = next(iter(self.stale), None)
        if topic is None:
            return None
        avoided = self._to_avoid(topic)
        try:
            plan = plan_topic(
                self._ontology, self._som, self.available, topic, avoided, self._method
            )
        except ShsaError as error:
            self._answers[topic] = error
        else:
            self._answers[topic] = plan
            for service in plan.services:
                self._uses.setdefault(service, set()).add(topic)
        self._avoided[topic] = avoided
        return topic

    def lookup(
        self,
        topic: str,
        available: Optional[AbstractSet[Service]] = None,
        excluded: Collection[str] = (),
    ) -> Optional[TopicPlan]:
        """The plan for `topic`, None if it is to be searched for.

        With `available` and `excluded`, which may be newer than the last update, only if none of the plan's
        services is gone or excluded. Raises the error that a search would raise.
        """
        answer = self._answers.get(topic)
        if isinstance(answer, ShsaError):
            raise answer
        if answer is not None and (available is not None or excluded):
            for service in answer.services:
                if available is not None and service not in available:
                    return None
                if service.node in excluded or service.topic in excluded:
                    return None
        return answer

    def _to_avoid(self, topic: str) -> FrozenSet[str]:
        """The topic, and the nodes that are to publish it or do."""
        nodes = {service.node for service in self._som.of_topic(topic)}
        return frozenset({topic} | nodes | self._nodes.get(topic, set()))

    def _derived_from(self, services: Iterable[Service]) -> List[str]:
        """The topics with a property that can be derived from one that the services provide."""
        stack = [self._ontology.network.number(service.property) for service in services]
        seen = set(stack)
        while stack:
            for output in self._users.get(stack.pop(), ()):
                if output not in seen:
                    seen.add(output)
                    stack.append(output)
        return [
            topic for topic, numbers in self._properties.items() if not seen.isdisjoint(numbers)
        ]

    def _drop(self, topic: str) -> None:
        answer = self._answers.pop(topic, None)
        if isinstance(answer, TopicPlan):
            for service in answer.services:
                self._uses[service].discard(topic)

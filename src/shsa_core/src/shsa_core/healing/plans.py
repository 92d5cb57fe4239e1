"""Plans: what takes a failed topic over. One substitute fills all fields of the topic that the SOM maps."""
from dataclasses import dataclass, field
from itertools import islice
from typing import AbstractSet, Collection, Dict, FrozenSet, Iterable, Iterator, List, Optional
from typing import Sequence, Set, Tuple, Union

from shsa_core.codegen.generator import Program, generate
from shsa_core.errors import GenerationError, ModelError, NoSubstitute, ShsaError
from shsa_core.language.expression import parse_expression
from shsa_core.model.network import Network
from shsa_core.model.ontology import Ontology
from shsa_core.model.relation import TransferFunction
from shsa_core.model.som import Service, Som
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import Derivation, Rated, ServiceTable, joint, rate_function
from shsa_core.search.orr import first_found
from shsa_core.search.ranking import Ranking
from shsa_core.search.substitutes import SMALLEST_QUALITY

METHODS = ("best", "orr")
# How many derivations are passed over because no code can be generated for them, as for a very large one.
REFUSED_AT_MOST = 100


@dataclass(frozen=True)
class TopicPlan:
    """How a topic is taken over: the substitute's program, and where it comes from.

    Plans are equal if they do the same: the same topic and program. `quality`, in (0, 1], is the product over all
    fields; 0 for safe values, which promise nothing. `derivations` follow `program.outputs`; `services` are the inputs. `proven_best`: no plan that was
    asked for is better.
    """

    topic: str
    program: Program
    quality: float = field(compare=False)
    relations: Tuple[str, ...] = field(compare=False)
    proven_best: bool = field(compare=False)
    derivations: Tuple[Derivation, ...] = field(compare=False, repr=False)
    services: Tuple[Service, ...] = field(compare=False, repr=False)

    @property
    def safe(self) -> bool:
        """Whether it publishes safe values."""
        return self.quality == 0.0


def plan_topic(
    ontology: Ontology,
    som: Som,
    available: Iterable[Service],
    topic: str,
    excluded: Iterable[str] = (),
    method: str = "best",
    tried: Collection[TopicPlan] = (),
) -> TopicPlan:
    """The best plan for `topic`, other than those `tried`, from available services.

    Neither the topic itself nor the nodes and topics `excluded` are used. `method`: `best`; or `orr`, the first
    found. Raises NoSubstitute with what is missing, GenerationError if only relations that cannot be executed
    would do, ModelError if the SOM does not have the topic.
    """
    fields = [(service.property, service.path) for service in som.of_topic(topic)]
    if not fields:
        raise ModelError(topic, f"the SOM has no such topic; it has {', '.join(som.topics())}")
    services = ServiceTable(ontology.network, available, [*excluded, topic])
    return plan_fields(ontology, services, topic, fields, method, tried)


def safe_plan(som: Som, topic: str) -> Optional[TopicPlan]:
    """The plan that publishes the safe values of a topic; None if the SOM gives none. Its quality is 0."""
    parts = []
    for service in som.of_topic(topic):
        if service.last_resort.value is not None:
            text = repr(service.last_resort.value)
            constant = TransferFunction(
                "safe value", service.property, (), parse_expression(text), text=text
            )
            parts.append((Derivation(service.property, None, constant), service.path))
    if not parts:
        return None
    derivations = tuple(derivation for derivation, _ in parts)
    return TopicPlan(topic, generate(parts, {}), 0.0, ("safe value",), True, derivations, ())


def plan_fields(
    ontology: Ontology,
    services: ServiceTable,
    topic: str,
    fields: Sequence[Tuple[str, str]],
    method: str = "best",
    tried: Collection[TopicPlan] = (),
) -> TopicPlan:
    """The plan that gives the fields of a topic, pairs of property and path, their properties again.

    The rest is as in `plan_topic`.
    """
    if method not in METHODS:
        raise ModelError("method", f"{method!r} is not known; allowed are {', '.join(METHODS)}")
    properties = [name for name, _ in fields]
    outputs = [path for _, path in fields]
    refused: Optional[GenerationError] = None
    failed = set()
    found = _derivations(ontology.network, services, properties, method)
    for rated, proven_best in islice(found, len(tried) + REFUSED_AT_MOST):
        derivations = rated.derivation.inputs
        try:
            program = generate(list(zip(derivations, outputs)), ontology.constants)
        except GenerationError as error:
            refused = refused or error
            continue
        plan = TopicPlan(
            topic,
            program,
            max(rated.quality, SMALLEST_QUALITY),
            tuple(dict.fromkeys(r for d in derivations for r in d.relations())),
            proven_best,
            derivations,
            rated.derivation.services(),
        )
        if plan not in tried:
            return plan
        failed.add(plan)
    if refused is not None:
        raise refused
    if failed:
        raise NoSubstitute(properties, (), tried=len(failed))
    raise _nothing(ontology, services, properties, outputs)


def _derivations(
    network: Network, services: ServiceTable, properties: Sequence[str], method: str
) -> Iterator[Tuple[Rated, bool]]:
    """Joint derivations of the properties: the one by `method`, then all, best first; and if it is proven best."""
    numbers = [network.number(name) for name in properties]

    def executable(function: int) -> bool:
        return network.functions[function].expression is not None

    if method == "orr":
        firsts = [first_found(network, services, number, executable) for number in numbers]
    else:
        best = BestDerivations(network, services, executable)
        for number in numbers:
            best.settle(number)
        firsts = [best.ratings.rated(number) for number in numbers]
    parts = [rated for rated in firsts if rated is not None]
    if len(parts) == len(properties):
        yield rate_function(joint(properties), parts), method == "best"
        for rated in Ranking(network, services, executable).joint(numbers):
            yield rated, True


def _nothing(
    ontology: Ontology, services: ServiceTable, properties: Sequence[str], outputs: Sequence[str]
) -> ShsaError:
    """Why there is no plan: what is missing, or the relation that cannot be executed."""
    best = BestDerivations(ontology.network, services)
    numbers = [ontology.network.number(name) for name in properties]
    lost = [number for number in numbers if not best.settle(number)]
    if lost:
        missing = {name for number in lost for name in best.missing(number)}
        return NoSubstitute(properties, sorted(missing))
    derivations = [best.ratings.derivation(number) for number in numbers]
    try:
        generate(list(zip(derivations, outputs)), ontology.constants)
    except GenerationError as error:
        return error
    raise AssertionError("what can be generated was found before")


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

"""How resilient a robot is: what replaces each needed topic, and which nodes must not fail."""
from itertools import combinations
from math import comb
from typing import Collection, Dict, FrozenSet, Iterable, Iterator, List, Sequence, Set, Tuple

from shsa_core.analysis.failures import Failures
from shsa_core.analysis.fragility import AS_IT_IS, Fragility
from shsa_core.analysis.remedies import Remedies
from shsa_core.analysis.report import Alternative, Cut, NodeReport, Report, Survival, TopicReport
from shsa_core.model.ontology import Ontology
from shsa_core.model.quality import cost
from shsa_core.model.som import Service, Som
from shsa_core.search.derivation import LOST
from shsa_core.search.ratings import Ratings

Nodes = FrozenSet[str]


def analyse(ontology: Ontology, som: Som, size: int = 2) -> Report:
    """How resilient a robot is, with all cuts of up to `size` nodes, two at least.

    Every service in the SOM counts as available until its node fails. Relations that cannot be executed do not
    count. The cuts are exact: a set of nodes is a cut if no substitute avoids it, and each of its nodes lies on a
    substitute that avoids the others (hitting sets; R. Reiter, A theory of diagnosis from first principles, 1987).
    """
    return _Analysis(ontology, som, max(size, 2)).report()


class _Analysis:
    def __init__(self, ontology: Ontology, som: Som, size: int) -> None:
        self._ontology = ontology
        self._network = ontology.network
        self._som = som
        self._size = size
        self._fragility = Fragility(ontology, som)
        self._failures = Failures(ontology.network, som, self._executable)
        self._fields: Dict[str, Tuple[str, ...]] = {}  # the properties of the needed topics
        self._hosted: Dict[str, List[str]] = {}  # the needed topics by their node
        for service in som:
            if service.needed and service.topic not in self._fields:
                fields = tuple(s.property for s in som.of_topic(service.topic))
                self._fields[service.topic] = fields
                self._hosted.setdefault(service.node, []).append(service.topic)

    def report(self) -> Report:
        """The whole analysis."""
        topics: Dict[str, TopicReport] = {}
        for node, hosted in self._hosted.items():
            topics.update(self._topics(node, hosted))
        cuts = _robot_cuts(topics.values())
        survival = _survived(len(self._fragility.nodes), cuts)
        remedies = Remedies(self._ontology, self._som, self._fragility, topics.values())
        return Report(
            tuple(topics[topic] for topic in self._fields),
            tuple(self._node(node, topics.values()) for node in self._fragility.nodes),
            cuts,
            survival,
            remedies.most_helpful(remedies.sensors(), survival),
            remedies.most_helpful(remedies.relations(), survival),
        )

    def _topics(self, node: str, hosted: Sequence[str]) -> Iterator[Tuple[str, TopicReport]]:
        """The reports on the needed topics of a node."""
        ratings = self._failures.ratings([node])
        lost = self._fragility.after([node])
        for topic in hosted:
            fields = self._fields[topic]
            numbers = [self._network.number(name) for name in fields]
            dead = [number for number in numbers if ratings[number] == LOST]
            missing = {name for n in dead for name in self._failures.missing(n, ratings)}
            alternatives = [a for name in fields for a in self._alternatives(name, node)]
            yield topic, TopicReport(
                topic,
                node,
                fields,
                None if dead else _product(ratings[number][4] for number in numbers),
                () if dead else _nodes(_read(ratings, numbers)),
                tuple(sorted(missing)),
                tuple(alternatives),
                _sorted(self._cuts(fields, frozenset([node]), lost)),
            )

    def _alternatives(self, name: str, failed: str) -> List[Alternative]:
        """For a lost property each service of it, and each relation with its best inputs; best first."""
        network, number = self._network, self._network.number(name)
        ratings = self._failures.ratings([failed], blocked=number)
        found = [
            ((cost(s.quality), 0, 1), Alternative(name, s.path, s.quality, (s.path,), (s.node,)))
            for s in ratings.services.of(number)
        ]
        for function in filter(self._executable, network.functions_of(number)):
            rating = ratings.by_function(function)
            if rating != LOST:
                read = _read(ratings, network.inputs_of(function))
                paths = tuple(service.path for service in read)
                relation = network.functions[function].relation
                alternative = Alternative(name, relation, rating[4], paths, _nodes(read))
                found.append((rating[:3], alternative))
        found.sort(key=lambda pair: pair[0])
        return [alternative for _, alternative in found]

    def _executable(self, function: int) -> bool:
        return self._network.functions[function].expression is not None

    def _cuts(self, fields: Sequence[str], failed: Nodes, lost: Dict[int, int]) -> Set[Nodes]:
        """The smallest cuts of a topic that have the nodes `failed`, after which its properties are at `lost`."""
        bits = self._fragility.bits(fields, lost)
        if bits & AS_IT_IS:
            return {failed}
        cuts = {failed | {node} for node in self._fragility.names(bits) if node not in failed}
        if len(failed) + 1 < self._size:
            numbers = [self._network.number(name) for name in fields]
            for node in _nodes(_read(self._failures.ratings(failed), numbers)):
                more = failed | {node}
                if more not in cuts:
                    cuts |= self._cuts(fields, more, self._fragility.after(more))
        return _smallest(cuts)

    def _node(self, node: str, topics: Iterable[TopicReport]) -> NodeReport:
        own = [topic for topic in topics if topic.node == node]
        return NodeReport(
            node,
            tuple(topic.topic for topic in own if topic.quality is None),
            tuple((topic.topic, topic.quality) for topic in own if topic.quality is not None),
            tuple(topic.topic for topic in topics if node in topic.reads),
        )


def _survived(nodes: int, cuts: Iterable[Cut]) -> Survival:
    """The shares of single and double failures that a robot of so many nodes survives."""
    singles = sum(len(cut.nodes) == 1 for cut in cuts)
    doubles = sum(len(cut.nodes) == 2 for cut in cuts)
    if nodes < 2:
        return Survival(1.0 - singles, 1.0)
    survived = comb(nodes - singles, 2) - doubles
    return Survival(1 - singles / nodes, survived / comb(nodes, 2))


def _robot_cuts(topics: Collection[TopicReport]) -> Tuple[Cut, ...]:
    """The smallest sets of nodes that lose any needed topic, each with all that it loses."""
    losing: Dict[Nodes, List[str]] = {}
    for topic in topics:
        for cut in topic.cuts:
            losing.setdefault(frozenset(cut), []).append(topic.topic)
    smallest = _smallest(losing)
    return tuple(Cut(nodes, tuple(losing[frozenset(nodes)])) for nodes in _sorted(smallest))


def _sorted(sets: Iterable[Nodes]) -> Tuple[Tuple[str, ...], ...]:
    """Sets of nodes in a stable order, the small ones first."""
    return tuple(sorted((tuple(sorted(nodes)) for nodes in sets), key=lambda n: (len(n), n)))


def _read(ratings: Ratings, numbers: Iterable[int]) -> Tuple[Service, ...]:
    """The services that the best derivations of several properties read."""
    derivations = [ratings.derivation(number) for number in numbers]
    return tuple(dict.fromkeys(s for d in derivations for s in d.services()))


def _nodes(services: Iterable[Service]) -> Tuple[str, ...]:
    return tuple(dict.fromkeys(service.node for service in services))


def _product(factors: Iterable[float]) -> float:
    product = 1.0
    for factor in factors:
        product *= factor
    return product


def _smallest(sets: Iterable[Nodes]) -> Set[Nodes]:
    """The sets of which no other is a part."""
    smallest: Set[Nodes] = set()
    for nodes in sorted(sets, key=len):
        parts = (frozenset(p) for n in range(1, len(nodes)) for p in combinations(nodes, n))
        if smallest.isdisjoint(parts):
            smallest.add(nodes)
    return smallest

"""How resilient a robot is: what replaces each needed service, and which nodes must not fail."""
from itertools import combinations
from math import comb
from typing import Dict, FrozenSet, Iterable, Iterator, List, Sequence, Set, Tuple

from shsa_core.analysis.failures import Failures
from shsa_core.analysis.fragility import Fragility
from shsa_core.analysis.remedies import Remedies
from shsa_core.analysis.report import Alternative, Cut, NodeReport, Report, ServiceReport, Survival
from shsa_core.model.ontology import Ontology
from shsa_core.model.quality import cost
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import LOST
from shsa_core.search.ratings import Ratings

Nodes = FrozenSet[str]


def analyse(ontology: Ontology, som: Som, size: int = 2) -> Report:
    """How resilient a robot is, with all cuts of up to `size` nodes, two at least.

    Every service in the SOM counts as available until its node fails. Relations that cannot be
    executed do not count. The cuts are exact: a set of nodes is a cut if no substitute avoids it,
    and each of its nodes lies on a substitute that avoids the others (hitting sets; R. Reiter, A
    theory of diagnosis from first principles, 1987).
    """
    return _Analysis(ontology, som, max(size, 2)).report()


class _Analysis:
    def __init__(self, ontology: Ontology, som: Som, size: int) -> None:
        self._ontology = ontology
        self._network = ontology.network
        self._som = som
        self._size = size
        self._fragility = Fragility(ontology, som)
        self._failures = Failures(ontology.network, som.sources, self._executable)
        self._failed: Nodes = frozenset()
        self._left: Dict[int, int] = {}
        self._hosted: Dict[str, List[Service]] = {}  # the needed services by their node
        for service in som.needed():
            self._hosted.setdefault(service.node, []).append(service)

    def report(self) -> Report:
        """The whole analysis."""
        found: Dict[str, ServiceReport] = {}
        for node, hosted in self._hosted.items():
            found.update(self._services(node, hosted))
        services = tuple(found[service.name] for service in self._som.needed())
        cuts = _robot_cuts(services)
        survival = _survived(len(self._fragility.nodes), cuts)
        remedies = Remedies(self._ontology, self._som, self._fragility, services)
        return Report(
            services,
            tuple(self._node(node, services) for node in self._fragility.nodes),
            cuts,
            survival,
            remedies.most_helpful(remedies.sensors(), survival),
            remedies.most_helpful(remedies.relations(), survival),
        )

    def _services(
        self, node: str, hosted: Sequence[Service]
    ) -> Iterator[Tuple[str, ServiceReport]]:
        """The reports on the needed services of a node."""
        failure = self._failures.after([node])
        ratings = failure.ratings
        for service in hosted:
            names = service.properties
            numbers = [self._network.number(name) for name in names]
            dead = [number for number in numbers if ratings[number] == LOST]
            missing = {name for n in dead for name in self._failures.missing(n, failure)}
            alternatives = [a for name in names for a in self._alternatives(name, node)]
            yield service.name, ServiceReport(
                service.name,
                service.topic,
                node,
                names,
                None if dead else _product(ratings[number][4] for number in numbers),
                () if dead else _nodes(_read(ratings, numbers)),
                tuple(sorted(missing)),
                tuple(alternatives),
                _sorted(self._cuts(names, frozenset([node]))),
            )

    def _alternatives(self, name: str, failed: str) -> List[Alternative]:
        """For a lost property its sources, and relations with their best inputs; best first."""
        network, number = self._network, self._network.number(name)
        ratings = self._failures.after([failed], blocked=number).ratings
        found = [
            ((cost(s.quality), 0, 1), Alternative(name, s.path, s.quality, (s.path,), (s.node,)))
            for s in ratings.sources.of(number)
        ]
        for function in filter(self._executable, network.functions_of(number)):
            rating = ratings.by_function(function)
            if rating != LOST:
                read = _read(ratings, network.inputs_of(function))
                paths = tuple(source.path for source in read)
                relation = network.functions[function].relation
                alternative = Alternative(name, relation, rating[4], paths, _nodes(read))
                found.append((rating[:3], alternative))
        found.sort(key=lambda pair: pair[0])
        return [alternative for _, alternative in found]

    def _executable(self, function: int) -> bool:
        return self._network.functions[function].law is not None

    def _cuts(self, names: Sequence[str], failed: Nodes) -> Set[Nodes]:
        """The smallest cuts of a service that have the nodes `failed`, one of which is its own."""
        if any(self._fragility.bits(names) & self._fragility.bit(node) for node in failed):
            return {failed}
        bits = self._fragility.bits(names, self._left_by(failed))
        cuts = {failed | {node} for node in self._fragility.names(bits) if node not in failed}
        if len(failed) + 1 < self._size:
            numbers = [self._network.number(name) for name in names]
            for node in _nodes(_read(self._failures.after(failed).ratings, numbers)):
                more = failed | {node}
                if more not in cuts:
                    cuts |= self._cuts(names, more)
        return _smallest(cuts)

    def _left_by(self, failed: Nodes) -> Dict[int, int]:
        """The bits of each property after some failures.

        They are kept for the next service of the same node.
        """
        if self._failed != failed:
            self._failed, self._left = failed, self._fragility.after(failed)
        return self._left

    def _node(self, node: str, services: Iterable[ServiceReport]) -> NodeReport:
        own = [service for service in services if service.node == node]
        return NodeReport(
            node,
            tuple(s.service for s in own if s.quality is None),
            tuple((s.service, s.quality) for s in own if s.quality is not None),
            tuple(s.service for s in services if node in s.reads),
        )


def _survived(nodes: int, cuts: Iterable[Cut]) -> Survival:
    """The shares of single and double failures that a robot of so many nodes survives."""
    singles = sum(len(cut.nodes) == 1 for cut in cuts)
    doubles = sum(len(cut.nodes) == 2 for cut in cuts)
    if nodes < 2:
        return Survival(1.0 - singles, 1.0)
    survived = comb(nodes - singles, 2) - doubles
    return Survival(1 - singles / nodes, survived / comb(nodes, 2))


def _robot_cuts(services: Iterable[ServiceReport]) -> Tuple[Cut, ...]:
    """The smallest sets of nodes that lose any needed service, each with all that it loses."""
    losing: Dict[Nodes, List[str]] = {}
    for service in services:
        for cut in service.cuts:
            losing.setdefault(frozenset(cut), []).append(service.service)
    smallest = _smallest(losing)
    return tuple(Cut(nodes, tuple(losing[frozenset(nodes)])) for nodes in _sorted(smallest))


def _sorted(sets: Iterable[Nodes]) -> Tuple[Tuple[str, ...], ...]:
    """Sets of nodes in a stable order, the small ones first."""
    return tuple(sorted((tuple(sorted(nodes)) for nodes in sets), key=lambda n: (len(n), n)))


def _read(ratings: Ratings, numbers: Iterable[int]) -> Tuple[Source, ...]:
    """The sources that the best derivations of several properties read."""
    derivations = [ratings.derivation(number) for number in numbers]
    return tuple(dict.fromkeys(s for d in derivations for s in d.sources()))


def _nodes(sources: Iterable[Source]) -> Tuple[str, ...]:
    return tuple(dict.fromkeys(source.node for source in sources))


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

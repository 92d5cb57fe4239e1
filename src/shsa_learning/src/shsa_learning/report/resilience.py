"""Analyses how resilient a robot is: what replaces each needed service, and what must not fail."""
from dataclasses import replace
from itertools import combinations
from math import comb, prod
from typing import Dict, FrozenSet, Iterable, List, Optional, Sequence, Set, Tuple

from shsa_core.analysis.budget import check_budgets
from shsa_learning.fragility import Fragility
from shsa_learning.report.failures import Failures
from shsa_learning.report.remedies import Remedies
from shsa_learning.report.report import Alternative, Cut, NodeReport, Report, ServiceReport
from shsa_learning.report.report import Survival, survival
from shsa_core.codegen.choice import ordered
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import GenerationError, NoSubstitute
from shsa_core.model.error import Error, refusal
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.model.som import Som
from shsa_core.search.derivation import LOST, Derivation, rate_source
from shsa_core.search.best import Ratings
from shsa_learning.schedulability import check_placements, takeovers

Nodes = FrozenSet[str]


def analyse(ontology: Ontology, som: Som, size: int = 2) -> Report:
    """Return how resilient a robot is, with all cuts of up to `size` causes, two at least.

    A cause is a node, or what services fail with. Every service in the SOM counts as available
    until one of its causes fails. Relations that cannot be executed do not count. The cuts are
    exact: a set of causes is a cut if no substitute avoids it, and each of its causes lies on a
    substitute that avoids the others (hitting sets; R. Reiter, A theory of diagnosis from first
    principles, 1987).
    """
    return _Analysis(ontology, som, max(size, 2)).report()


class _Analysis:
    def __init__(self, ontology: Ontology, som: Som, size: int) -> None:
        self._ontology = ontology
        self._network = ontology.network
        self._som = som
        self._size = size
        self._fragility = Fragility(ontology, som)
        self._plan_of = takeovers(ontology, som.sources)
        self._predictor = predictor(ontology, som.sources)
        self._failures = Failures(ontology.network, som.sources)
        self._failed: Nodes = frozenset()
        self._left: Dict[int, int] = {}
        self._hosted: Dict[str, List[Service]] = {}  # the needed services by what they fail with
        for service in som.may_be_needed():
            for cause in service.causes:
                self._hosted.setdefault(cause, []).append(service)
        self._cuts_of: Dict[str, Set[Nodes]] = {}  # by service

    def report(self) -> Report:
        """Return the whole analysis."""
        for cause, hosted in self._hosted.items():
            for service in hosted:
                cuts = self._cuts(service.properties, frozenset([cause]))
                self._cuts_of.setdefault(service.name, set()).update(cuts)
        services = tuple(self._service(service) for service in self._som.may_be_needed())
        robot_cuts = _robot_cuts(services)
        remedies = Remedies(self._ontology, self._som, self._fragility, services)
        sensors, relations = remedies.sensors(), remedies.relations()
        kinds = {"sensor": sensors, "relation": relations}
        return Report(
            services,
            tuple(self._node(cause, services) for cause in self._fragility.causes),
            robot_cuts,
            _survived(len(self._fragility.causes), robot_cuts),
            sensors.best,
            relations.best,
            tuple(kind for kind, found in kinds.items() if found.exact),
            tuple(what for _, what in check_budgets(self._som)),
            tuple(finding.what for finding in check_placements(self._ontology, self._som)),
        )

    def _service(self, service: Service) -> ServiceReport:
        """Return the report on a needed service."""
        missing: Tuple[str, ...] = ()
        refused = ""
        plan = None
        try:
            plan = self._plan_of(service)
        except NoSubstitute as none:
            missing, refused = none.missing, none.refused
        except GenerationError as error:
            refused = str(error)
        cuts = self._cuts_of[service.name]
        if plan is None:
            cuts.add(frozenset([service.node]))
        names = service.properties
        return ServiceReport(
            service.name,
            service.topic,
            service.node,
            names,
            None if plan is None else plan.quality,
            () if plan is None else _causes(plan.inputs),
            missing,
            refused,
            tuple(a for name in names for a in self._alternatives(name, service)),
            _sorted(_smallest(cuts)),
            () if plan is None else plan.errors,
        )

    def _alternatives(self, name: str, service: Service) -> List[Alternative]:
        """Return a lost property's sources, and relations with their best inputs; best first."""
        network, number = self._network, self._network.number(name)
        ratings = self._failures.after([service.node], blocked=number)
        found = [
            (
                rate_source(s).key,
                Derivation(name, s, None),
                Alternative(name, s.path, s.quality, (s.path,), (s.node,)),
            )
            for s in ratings.sources.of(number)
        ]
        for function in filter(network.executable, network.functions_of[number]):
            rating = ratings.by_function(function)
            if rating != LOST:
                inputs = tuple(map(ratings.derivation, network.inputs[function]))
                by = Derivation(name, None, network.functions[function], inputs)
                read = by.sources()
                paths = tuple(source.path for source in read)
                relation = network.functions[function].relation
                alternative = Alternative(name, relation, rating[4], paths, _nodes(read))
                found.append((rating[:3], by, alternative))
        found.sort(key=lambda each: each[0])
        predictor = self._predictor
        derivations = [derivation for _, derivation, _ in found]
        errors: Sequence[Optional[Error]] = [None] * len(found)
        order = list(range(len(found)))
        if predictor is not None:
            errors, order = predictor.of(derivations), ordered(derivations, predictor)

        def wished(i: int) -> Tuple[bool, bool, bool]:
            """Order what may be used, by nodes that are not avoided, by preferred relations."""
            avoided = set(service.avoid).intersection(found[i][2].nodes)
            preferred = set(service.prefer).intersection(derivations[i].relations())
            return bool(refusal(errors[i], None)), bool(avoided), not preferred

        return [replace(found[i][2], error=errors[i]) for i in sorted(order, key=wished)]

    def _cuts(self, names: Sequence[str], failed: Nodes) -> Set[Nodes]:
        """Return the smallest cuts of a service that have the causes `failed`, one its own."""
        if any(self._fragility.bits(names) & self._fragility.bit(node) for node in failed):
            return {failed}
        bits = self._fragility.bits(names, self._left_by(failed))
        cuts = {failed | {node} for node in self._fragility.names(bits) if node not in failed}
        if len(failed) + 1 < self._size:
            numbers = [self._network.number(name) for name in names]
            for cause in _causes(_read(self._failures.after(failed), numbers)):
                more = failed | {cause}
                if more not in cuts:
                    cuts |= self._cuts(names, more)
        return _smallest(cuts)

    def _left_by(self, failed: Nodes) -> Dict[int, int]:
        """Return the bits of each property after failures; kept for the node's next service."""
        if self._failed != failed:
            self._failed, self._left = failed, self._fragility.after(failed)
        return self._left

    def _node(self, cause: str, services: Sequence[ServiceReport]) -> NodeReport:
        own = {service.name for service in self._hosted.get(cause, ())}
        lost: List[str] = []
        healed: List[Tuple[str, float]] = []
        for service in services:
            if service.service not in own:
                continue
            quality = service.quality
            if cause != service.node:
                quality = None if (cause,) in service.cuts else self._quality(service, cause)
            if quality is None:
                lost.append(service.service)
            else:
                healed.append((service.service, quality))
        leaned_on = tuple(s.service for s in services if cause in s.reads)
        return NodeReport(cause, tuple(lost), tuple(healed), leaned_on)

    def _quality(self, service: ServiceReport, cause: str) -> float:
        """Return the quality of a service's substitute once a shared cause has failed."""
        ratings = self._failures.after([cause])
        return prod(ratings[self._network.number(name)][4] for name in service.properties)


def _survived(causes: int, cuts: Iterable[Cut]) -> Survival:
    """Return the shares of single and double failures that a robot survives."""
    singles = sum(len(cut.nodes) == 1 for cut in cuts)
    doubles = sum(len(cut.nodes) == 2 for cut in cuts)
    pairs = comb(causes, 2) - comb(causes - singles, 2) + doubles
    return survival(causes, singles, pairs)


def _robot_cuts(services: Iterable[ServiceReport]) -> Tuple[Cut, ...]:
    """Return the smallest sets of nodes that lose a needed service, with all that each loses."""
    losing: Dict[Nodes, List[str]] = {}
    for service in services:
        for cut in service.cuts:
            losing.setdefault(frozenset(cut), []).append(service.service)
    smallest = _smallest(losing)
    return tuple(Cut(nodes, tuple(losing[frozenset(nodes)])) for nodes in _sorted(smallest))


def _sorted(sets: Iterable[Nodes]) -> Tuple[Tuple[str, ...], ...]:
    """Sort sets of nodes, the small ones first."""
    return tuple(sorted((tuple(sorted(nodes)) for nodes in sets), key=lambda n: (len(n), n)))


def _read(ratings: Ratings, numbers: Iterable[int]) -> Tuple[Source, ...]:
    """Return the sources that the best derivations of several properties read."""
    derivations = [ratings.derivation(number) for number in numbers]
    return tuple(dict.fromkeys(s for d in derivations for s in d.sources()))


def _causes(sources: Iterable[Source]) -> Tuple[str, ...]:
    return tuple(dict.fromkeys(cause for s in sources for cause in s.service.causes))


def _nodes(sources: Iterable[Source]) -> Tuple[str, ...]:
    return tuple(dict.fromkeys(source.node for source in sources))


def _smallest(sets: Iterable[Nodes]) -> Set[Nodes]:
    """Return the sets of which no other is a part."""
    smallest: Set[Nodes] = set()
    for nodes in sorted(sets, key=len):
        parts = (frozenset(p) for n in range(1, len(nodes)) for p in combinations(nodes, n))
        if smallest.isdisjoint(parts):
            smallest.add(nodes)
    return smallest

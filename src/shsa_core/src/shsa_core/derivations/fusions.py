"""Fuses the followed derivations of a value, where their sum errs less than the best of them.

The shares are those of least squares by errors at the same moments, of two at a time. Without such
errors nothing is fused: covariance intersection of one number is the better of both. What is fused
is followed as any other, and told once it has proven better on what came after.
"""
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, sqrt
from typing import Dict, Iterable, Iterator, List, Mapping, Sequence, Tuple

from shsa_core.codegen.generator import NAMES, fuse
from shsa_core.codegen.plans import Plan, make_plan
from shsa_core.errors import ShsaError
from shsa_core.model.error import Error
from shsa_core.model.field import is_angle
from shsa_core.model.log import Level, Log
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service, Source
from shsa_core.derivations import settings
from shsa_core.derivations.calibrator import rms
from shsa_core.derivations.evaluation import Derivations, FollowedPlan, Output
from shsa_core.search.derivation import Derivation, Rated, rate_joint

Errors = Mapping[float, float]
"""By what a value erred, by the number of the turn."""
SMALLEST = 1e-300


@dataclass
class _Fused:
    """A fusion that is followed; `proven`: better than each of its parts on what came after."""

    followed: FollowedPlan
    parts: Sequence[Output]
    proven: bool = False

    @property
    def ratios(self) -> List[float]:
        """Return by how much it errs, compared with the best of its parts: in all, and in parts of
        the time, as some errors are rare and large; nothing: it is too early.
        """
        columns = [part.calibrator.errors for part in (*self.followed.outputs, *self.parts)]
        common = [time for time in columns[0] if all(time in column for column in columns)]
        if len(common) < settings.FUSED:
            return []
        step = -(-len(common) // settings.FUSED_BLOCKS)
        blocks = [common, *(common[i : i + step] for i in range(0, len(common), step))]
        errors = [[rms([column[time] for time in block]) for column in columns] for block in blocks]
        return [own / max(min(others), SMALLEST) for own, *others in errors]


class Fusions:
    """The fusions that are followed, one of a value at most. Times in s."""

    def __init__(self, ontology: Ontology, derivations: Derivations) -> None:
        self._ontology, self._derivations = ontology, derivations
        self._fused: Dict[Tuple[str, str], _Fused] = {}  # by service and property
        self._next: Dict[Tuple[str, str], float] = {}

    def tells(self, followed: FollowedPlan) -> bool:
        """Tell that a plan is no fusion, or one that has proven better."""
        return all(each.proven for each in self._fused.values() if each.followed is followed)

    def look(self, service: Service) -> Iterator[Log]:
        """Judge the fusions of a service, give up the worse ones, and tell of the better ones."""
        for source in service.sources:
            key = service.name, source.property
            known = self._fused.get(key)
            if known is None or known.followed not in self._derivations.plans(service.name):
                self._fused.pop(key, None)
                continue
            ratio, *blocks = known.ratios or [0.0]
            most = 1.0 if known.proven else settings.FUSED_GAIN
            there = set(known.parts) <= set(self._parts(source)) and known.followed.is_followed
            if ratio > most or max(blocks, default=0.0) > 1.0 or not there:
                del self._fused[key]
                self._derivations.give_up(known.followed)
            elif ratio and not known.proven:
                known.proven = True
                by = ", ".join(known.followed.plan.relations)
                text = f"{source.topic}: {by} errs {ratio:.2f} times as much as the best part"
                yield Log(Level.INFO, text)

    def propose(self, service: Service, time: float) -> List[FollowedPlan]:
        """Return new fusions of a service's values, which are to be followed."""
        found = []
        for source in service.sources:
            key = service.name, source.property
            if key in self._fused or time < self._next.get(key, -inf):
                continue
            parts = [] if is_angle(source.provision.field) else self._parts(source)
            weights = shares([part.calibrator.errors for part in parts])
            if len(weights) > 1:
                self._next[key] = time + settings.DRIFT_S
                chosen = [parts[i] for i in weights]
                with suppress(ShsaError):
                    followed = self._derivations.made(self._plan(source, chosen, weights.values()))
                    self._fused[key] = _Fused(followed, chosen)
                    found.append(followed)
        return found

    def _parts(self, source: Source) -> List[Output]:
        """Return what may be fused: nothing that is computed from the service itself."""
        service, ours = source.service.name, {each.followed for each in self._fused.values()}
        return [
            output
            for each in self._derivations.plans(service)
            if each.substitutes and each not in ours
            if not any(service in input_.service.upstream for input_ in each.plan.inputs)
            for output in each.outputs
            if output.source.property == source.property
        ]

    def _plan(self, source: Source, parts: Sequence[Output], weights: Iterable[float]) -> Plan:
        derivations = [part.derivation for part in parts]
        calibrations = (part.calibration for part in parts)
        function = fuse(derivations, list(zip(weights, calibrations))).function
        derivation = Derivation(function.output, None, function, tuple(derivations))
        joint = rate_joint([Rated((0, 0, 0), 1.0, derivation)])
        plan = make_plan(self._ontology, (source,), joint, False, None)
        least = settings.FUSED_GAIN * min(rms(part.calibrator.errors.values()) for part in parts)
        return replace(plan, errors=(Error(least),))


def shares(columns: Sequence[Errors]) -> Dict[int, float]:
    """Return the shares of the columns whose weighted sum errs clearly less than each; or one."""
    known = [i for i, column in enumerate(columns) if len(column) >= settings.FUSED]
    if not known:
        return {}
    first = min(known, key=lambda i: rms(columns[i].values()))
    found, sum_ = {first: 1.0}, columns[first]
    while len(found) < min(len(known), len(NAMES)):
        options = [(*_joined(sum_, columns[i]), i) for i in known if i not in found]
        ratio, share, sum_, i = min(options, key=lambda option: option[0])
        if ratio > settings.FUSED_GAIN:
            break
        found = {**{k: (1.0 - share) * old for k, old in found.items()}, i: share}
    return found


def _joined(one: Errors, other: Errors) -> Tuple[float, float, Errors]:
    """Return by how much less the best sum of both errs than one, the other's share, and it."""
    pairs = {time: (error, other[time]) for time, error in one.items() if time in other}
    a, b, c = (sum(x[i] * x[j] for x in pairs.values()) for i, j in ((0, 0), (1, 1), (0, 1)))
    c *= settings.SHRINKAGE
    share = (a - c) / (a + b - 2.0 * c) if a + b > 2.0 * c else 0.0
    if len(pairs) < settings.FUSED or not settings.LEAST_SHARE <= share <= 1 - settings.LEAST_SHARE:
        return inf, 0.0, one
    joined = {time: (1.0 - share) * x + share * y for time, (x, y) in pairs.items()}
    return rms(joined.values()) / sqrt(a / len(pairs)), share, joined

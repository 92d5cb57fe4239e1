"""Compares values with what others tell of them: derived from other services by the relations.

One witness never convicts: disagreement does not tell who is wrong; it is a suspicion that is told.
Of a sensor and two derivations that share no cause, the one is faulty that the other two contradict
while they agree: as intervals, each value with its error, over the last looks (Ratasich et al.,
SASO 2019). What is not healthy is no witness.
"""
from collections import deque
from dataclasses import dataclass, field
from math import hypot
from typing import Deque, Dict, List, NamedTuple, Optional, Tuple

from shsa_core.codegen.plans import plan_sources
from shsa_core.codegen.prediction import Predictor
from shsa_core.errors import ShsaError
from shsa_core.model.checks import LEARNED, Check, Finding, judge
from shsa_core.model.samples import WitnessSample
from shsa_core.model.error import Error, spread
from shsa_core.model.field import difference, is_angle
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.model.som import Som
from shsa_core.derivations import settings
from shsa_core.derivations.evaluation import Derivations, FollowedPlan
from shsa_core.search.derivation import SourceTable


@dataclass
class _Witness:
    """One derivation of a value. `calibrated`: by the gain and offset that the sensor had while
    nobody doubted it.

    `stated`: how far it may be from what is measured by the known errors, None: not known. `seen`:
    what was left of the difference, and when.
    """

    followed: FollowedPlan
    calibrated: bool
    stated: Optional[float]
    seen: Deque[Tuple[float, Error]] = field(default_factory=deque, compare=False)

    @property
    def nodes(self) -> str:
        """The nodes that it reads, in words."""
        return ", ".join(dict.fromkeys(each.node for each in self.followed.plan.inputs))

    @property
    def derived(self) -> Optional[float]:
        """The value that it tells now; None: it cannot."""
        output = self.followed.outputs[0]
        if output.derived is None or not self.calibrated:
            return output.derived
        return output.calibration(output.derived)

    @property
    def knows(self) -> bool:
        """True once it has compared for long enough to tell what is wrong."""
        return not self.calibrated or self.followed.outputs[0].calibration.error is not None

    def allowed(self, time: float) -> Optional[float]:
        """Return how far it may be: as stated, or as seen a while ago if less; None: not known.

        What is seen now may be widened by what shall be found, a sensor that drifts.
        """
        error, seen = self.followed.outputs[0].calibration.error, self.seen
        apart = settings.ERRORS_APART * settings.SAMPLE_S
        enough = error is not None and (error.n or 0) * apart >= settings.SETTLING_S
        if error is not None and enough and (not seen or seen[-1][1] is not error):
            seen.append((time, error))
        while len(seen) > 1 and seen[1][0] <= time - 2 * settings.SETTLING_S:
            seen.popleft()
        known = [] if self.stated is None else [self.stated]
        if seen and seen[0][0] <= time - 2 * settings.SETTLING_S:
            known.append(spread(seen[0][1]) or 0.0)
        return min(known, default=None)


class _Suspect(NamedTuple):
    """A value that the SOM wants compared. `check`: with how far off it may be."""

    source: Source
    check: Check
    witnesses: List[_Witness]


class Suspicion:
    """The evidence of others against one value in one life of its node.

    `doubts`: by service, what people are told of it though nobody is blamed.
    """

    def __init__(self, suspect: _Suspect) -> None:
        self.suspect = suspect
        self.finding: Optional[Finding] = None
        self.doubts: Dict[str, str] = {}
        # For so many looks in a row it is wrong: by two that agree, and by any.
        self._disputed = self._wrong = 0
        self._doubted: List[_Witness] = []
        # Differences to each witness, and between both, at the last looks in a row.
        self._differences: List[Deque[float]] = [
            deque(maxlen=settings.WITNESS_LOOKS) for _ in range(len(suspect.witnesses) + 1)
        ]

    @property
    def doubtful(self) -> bool:
        """True while any witness contradicts."""
        return self._wrong > 0

    def look(self, measured: Optional[float], time: float) -> None:
        """Compare with each witness that knows enough."""
        witnesses = self.suspect.witnesses
        apart = self._mean(-1, witnesses[0].derived, witnesses[-1].derived)
        told = self._told(measured, time)
        findings = [judge((self.suspect.check,), sample) for _, sample in told]
        wrong = [each for (each, _), finding in zip(told, findings) if finding is not None]
        alone = len(wrong) == 2 and _agree(apart, [sample for _, sample in told])
        self._disputed = self._disputed + 1 if alone else 0
        self._wrong = self._wrong + 1 if wrong else 0
        self.finding = None
        if self._disputed > settings.WITNESS_LOOKS and findings[0] is not None:
            other, sample = told[1]
            detail = f"{findings[0].detail}; by {other.nodes} it is {sample.derived:g}"
            self.finding = Finding(findings[0].kind, detail)
        lasts = self._wrong > settings.WITNESS_LOOKS and self.finding is None
        doubted = wrong if lasts else []
        if doubted != self._doubted:  # it is told once: numbers change with every look
            self._doubted = doubted
            self.doubts = _doubts(self.suspect, doubted, len(doubted) == len(told))

    def _told(self, measured: Optional[float], time: float) -> List[Tuple[_Witness, WitnessSample]]:
        found, (source, check, witnesses) = [], self.suspect
        for number, each in enumerate(witnesses):
            derived = each.derived
            mean = self._mean(number, measured, derived)
            allowed = each.allowed(time) if check.limit == LEARNED else float(check.limit)
            if measured is None or derived is None or mean is None or not each.knows:
                continue
            sample = WitnessSample(source.property, measured, derived, mean, each.nodes, allowed)
            found.append((each, sample))
        return found

    def _mean(self, number: int, one: Optional[float], other: Optional[float]) -> Optional[float]:
        """Add a difference; return their mean; None: a value is missing, or there are too few."""
        differences = self._differences[number]
        if one is None or other is None:
            differences.clear()
            return None
        angle = is_angle(self.suspect.source.provision.field)
        differences.append(abs(difference(one, other, angle)))
        count = len(differences)
        return sum(differences) / count if count == differences.maxlen else None


class Witnesses:
    """The values that the SOM wants compared; `suspects`: by service. Times in s."""

    def __init__(self, ontology: Ontology, derivations: Derivations) -> None:
        self._ontology, self._derivations = ontology, derivations
        self.suspects: Dict[str, List[_Suspect]] = {}

    def watch(self, som: Som, predictor: Optional[Predictor]) -> None:
        """Compare what `som` wants compared: what is compared as before goes on."""
        known = self._ontology.properties
        usable = [s for service in som for s in service.readable if s.property in known]
        table = SourceTable(self._ontology.network, usable)
        before, self.suspects = self.suspects, {service.name: [] for service in som}
        for source in usable:
            for check in source.provision.checks:
                if check.sample is WitnessSample:
                    witnesses = self._witnesses(source, table, check.limit == LEARNED, predictor)
                    if witnesses:
                        name, suspect = source.service.name, _Suspect(source, check, witnesses)
                        same = [each for each in before.get(name, []) if each == suspect]
                        self.suspects[name] += same or [suspect]

    def _witnesses(
        self, source: Source, table: SourceTable, by_errors: bool, predictor: Optional[Predictor]
    ) -> List[_Witness]:
        """Return up to two derivations that share no cause with the source or each other."""
        found: List[_Witness] = []
        excluded = {source.service.name, *source.service.wrong_with}
        while len(found) < 2:
            others = table.excluding(sorted(excluded))
            try:
                plan = plan_sources(self._ontology, (source,), others, predictor=predictor)
                followed = self._derivations.made(plan)
            except ShsaError:
                break  # nobody else can tell
            followed.witness = True
            if by_errors:
                followed.outputs[0].calibrate()
            spreads = spread(source.provision.error), spread(followed.outputs[0].stated)
            found.append(_Witness(followed, by_errors, _apart(*spreads)))
            for read in (each.service for each in plan.inputs):
                excluded.update((read.name, *read.wrong_with, *read.upstream))
        return found


def _agree(apart: Optional[float], samples: List[WitnessSample]) -> bool:
    """Tell if both witnesses agree with each other, and better than with what is measured."""
    most = _apart(samples[0].allowed, samples[1].allowed)
    if most is None or apart is None or apart > most:
        return False
    return all(apart < sample.mean for sample in samples)


def _doubts(suspect: _Suspect, wrong: List[_Witness], all_differ: bool) -> Dict[str, str]:
    """Return what is shown of the services of which one may be wrong, if anybody is.

    A derivation that the sensor and the other derivation contradict brings its own inputs in doubt.
    """
    if not wrong:
        return {}
    source = suspect.source
    told = [f"by {each.nodes} {each.derived:g}" for each in wrong]
    text = f"{source.property} is {' and '.join(told)}, which {source.node} "
    if all_differ:
        return {source.service.name: f"{text}contradicts: nobody can tell which is wrong"}
    text += f"and {', '.join(each.nodes for each in suspect.witnesses if each not in wrong)} "
    return {
        each.service.name: f"{text}contradict" for one in wrong for each in one.followed.plan.inputs
    }


def _apart(one: Optional[float], other: Optional[float]) -> Optional[float]:
    """Return how far two values may be apart whose errors know nothing of each other."""
    return None if one is None or other is None else hypot(one, other)

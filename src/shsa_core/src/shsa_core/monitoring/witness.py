"""What other services say of a value: derived from them by the ontology's relations.

Disagreement alone does not tell who is wrong. Of a sensor and two derivations that share no node,
the two that agree are believed. What is not healthy is no witness.
"""
from dataclasses import dataclass, field
from math import isfinite
from typing import Dict, Iterable, List, Optional, Set, Tuple

from shsa_core.codegen.plans import Plan, plan_sources
from shsa_core.codegen.prediction import Predictor, predictor
from shsa_core.codegen.program import compile_program
from shsa_core.errors import ShsaError
from shsa_core.model.checks import LEARNED, Check, WitnessSample
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Deadlines, Service, Source
from shsa_core.model.som import Som
from shsa_core.monitoring.calibration import Calibrator
from shsa_core.monitoring.evidence import Finding, judge
from shsa_core.monitoring.gaps import LOOKS, Gap, apart_at_most, spread
from shsa_core.monitoring.testimony import Testimony
from shsa_core.search.derivation import SourceTable

PERIOD_S = 0.2
"""Between two looks: a witness costs the same however fast its topic is."""
INDEPENDENT = 2

Key = Tuple[str, str]
"""A service and a property."""


@dataclass
class _Suspect:
    """One value that is compared with what others say; `disputed`: for so many looks in a row.

    `between`: how far two witnesses are from each other.
    `doubts`: what is shown of services that may be wrong, though nobody is blamed.
    """

    source: Source
    checks: Tuple[Check, ...]
    witnesses: List[Testimony]
    between: Gap = field(default_factory=Gap)
    looked: Optional[float] = None
    disputed: int = 0
    doubtful: int = 0
    finding: Optional[Finding] = None
    doubts: Dict[str, str] = field(default_factory=dict)

    @property
    def by_errors(self) -> bool:
        """Whether one witness alone blames nobody."""
        return by_errors(self.checks)


def by_errors(checks: Iterable[Check]) -> bool:
    """Whether the limit is that of the known errors."""
    return all(each.limit == LEARNED for each in checks)


class Witnesses:
    """The values that the SOM wants compared. Times in s."""

    def __init__(self, ontology: Optional[Ontology], deadlines: Deadlines) -> None:
        self._ontology, self._deadlines = ontology, deadlines
        self._suspects: Dict[str, List[_Suspect]] = {}
        self._wanted: Set[Key] = set()
        self._own: Dict[Key, Tuple[float, float]] = {}
        self._trusted: Dict[Key, Tuple[float, float]] = {}
        self._predictor: Optional[Predictor] = None

    def watch(self, som: Som) -> None:
        """The services are those of `som` now; what was learned of differences begins anew."""
        self._suspects.clear()
        self._wanted.clear()
        self._own.clear()
        self._trusted.clear()
        if self._ontology is None:
            return
        self._predictor = predictor(self._ontology, som.sources)
        known = self._ontology.properties
        table = SourceTable(
            self._ontology.network,
            (source for source in som.sources if source.property in known),
        )
        for service in som:
            found = [self._suspect(source, table) for source in service.readable]
            self._suspects[service.name] = [each for each in found if each]
            for suspect in self._suspects[service.name]:
                sources = [each for witness in suspect.witnesses for each in witness.inputs]
                self._wanted.update(_key(each) for each in [suspect.source, *sources])

    def _suspect(self, source: Source, table: SourceTable) -> Optional[_Suspect]:
        checks = tuple(c for c in source.provision.checks if c.sample is WitnessSample)
        if not checks or self._ontology is None or source.property not in self._ontology.properties:
            return None
        own = spread(source.provision.error)
        witnesses: List[Testimony] = []
        excluded = {source.service.name, *source.service.wrong_with}
        while len(witnesses) < INDEPENDENT:
            try:
                plan = self._plan(source, table.excluding(sorted(excluded)))
                step = compile_program(plan.program.code, len(plan.inputs), 1).step
            except ShsaError:
                break  # nobody else can tell
            error = self._predictor.of(plan.derivations)[0] if self._predictor else None
            witness = Testimony(plan.inputs, step, apart_at_most(own, spread(error)))
            if by_errors(checks):
                witness.calibrator = Calibrator(error.rms if error else None)
            witnesses.append(witness)
            excluded.update(cause for each in plan.inputs for cause in each.service.wrong_with)
        return _Suspect(source, checks, witnesses) if witnesses else None

    def _plan(self, source: Source, table: SourceTable) -> Plan:
        assert self._ontology is not None
        question = self._ontology, source.service.name, (source,), table
        return plan_sources(*question, predictor=self._predictor)

    def take(
        self,
        service: Service,
        values: Iterable[Tuple[str, Optional[float]]],
        time: float,
        trusted: bool,
    ) -> None:
        """What the node of a service says of its properties; `trusted`: it may be a witness."""
        for name, value in values:
            key = service.name, name
            if key in self._wanted and value is not None and isfinite(value):
                self._own[key] = time, value
                if trusted:
                    self._trusted[key] = time, value

    def finding(self, service: Service, time: float) -> Optional[Finding]:
        """What is held against the node of a service, if its values differ from what is derived."""
        for suspect in self._suspects.get(service.name, ()):
            if suspect.looked is None or time - suspect.looked >= PERIOD_S:
                suspect.looked = time
                suspect.finding = self._look(suspect, time)
            if suspect.finding is not None:
                return suspect.finding
        return None

    def is_disputed(self, service: Service) -> bool:
        """Whether others differ from a value of a service, for however short a time."""
        return any(each.doubtful for each in self._suspects.get(service.name, ()))

    def doubts(self) -> Dict[str, str]:
        """By service: why it may be wrong, in words, though nobody can be blamed."""
        every = (suspect for each in self._suspects.values() for suspect in each)
        return {name: text for suspect in every for name, text in suspect.doubts.items()}

    def _look(self, suspect: _Suspect, time: float) -> Optional[Finding]:
        measured = self._value(self._own, suspect.source, time)
        for witness in suspect.witnesses:
            inputs = [self._value(self._trusted, each, time) for each in witness.inputs]
            witness.say(inputs, time)
            witness.gap.add(measured, witness.derived)
        first, last = suspect.witnesses[0], suspect.witnesses[-1]
        suspect.between.add(first.derived, last.derived)
        found = [each for each in suspect.witnesses if each.judges]
        finding = self._compare(suspect, found, measured)
        for witness in suspect.witnesses:
            trusted = self._value(self._trusted, suspect.source, time)
            witness.learn(trusted, time, suspect.doubtful > 0)
        return finding

    def _compare(
        self, suspect: _Suspect, found: List[Testimony], measured: Optional[float]
    ) -> Optional[Finding]:
        """What follows of a measured value and of what the witnesses `found` say."""
        if measured is None or not found:
            suspect.disputed = suspect.doubtful = 0
            suspect.doubts.clear()
            return None
        samples = [_sample(suspect.source, each, measured) for each in found]
        findings = [judge(suspect.checks, sample) for sample in samples]
        finding = None
        if findings[0] is not None and all(findings) and _agree(suspect, found):
            others = "".join(
                f"; by {', '.join(each.nodes)} it is {each.derived:g}" for each in found[1:]
            )
            finding = Finding(findings[0].kind, findings[0].detail + others)
        suspect.disputed = suspect.disputed + 1 if finding else 0
        suspect.doubtful = suspect.doubtful + 1 if any(findings) else 0
        alone = len(found) == 1
        nobody_knows = alone and (suspect.by_errors or self._in_dispute(found[0]))
        blamed = suspect.disputed > LOOKS and not nobody_knows
        suspect.doubts.clear()
        if suspect.doubtful > LOOKS and not blamed:
            wrong = [each for each, bad in zip(found, findings) if bad]
            suspect.doubts.update(_doubts(suspect, wrong, len(wrong) == len(found)))
        return finding if blamed else None

    def _in_dispute(self, witness: Testimony) -> bool:
        """Whether a witness stands on a value that may as well be the wrong one."""
        return any(
            suspect.source == source and suspect.disputed
            for source in witness.inputs
            for suspect in self._suspects.get(source.service.name, ())
        )

    def _value(
        self, values: Dict[Key, Tuple[float, float]], source: Source, time: float
    ) -> Optional[float]:
        """The newest value of a source; None if it is stale."""
        found = values.get(_key(source))
        deadline = self._deadlines.of(source.service)
        if found is None or deadline is not None and time - found[0] > deadline:
            return None
        return found[1]


def _agree(suspect: _Suspect, found: List[Testimony]) -> bool:
    """Whether the witnesses agree with each other, and better than with what is measured."""
    apart = suspect.between.mean
    if len(found) == 1 or apart is None:
        return True
    if suspect.by_errors:
        most = apart_at_most(found[0].allowed, found[-1].allowed)
        if most is None or apart > most:
            return False
    return all(each.gap.mean is not None and apart < each.gap.mean for each in found)


def _doubts(suspect: _Suspect, wrong: List[Testimony], all_differ: bool) -> Dict[str, str]:
    """What is shown of the services of which one may be wrong.

    A derivation that the sensor and the other derivation contradict brings its own inputs in doubt.
    """
    source = suspect.source
    told = [f"by {', '.join(each.nodes)} {each.derived:g}" for each in wrong]
    text = f"{source.property} is {' and '.join(told)}, which {source.node} "
    if all_differ:
        text += "contradicts: nobody can tell which is wrong"
        return {source.service.name: text}
    others = [each for each in suspect.witnesses if each not in wrong]
    text += f"and {', '.join(node for each in others for node in each.nodes)} contradict"
    return {each.service.name: text for witness in wrong for each in witness.inputs}


def _sample(source: Source, witness: Testimony, measured: float) -> WitnessSample:
    assert witness.gap.mean is not None and witness.derived is not None
    return WitnessSample(
        source.property,
        measured,
        witness.derived,
        witness.gap.mean,
        witness.nodes,
        witness.allowed,
    )


def _key(source: Source) -> Key:
    return source.service.name, source.property

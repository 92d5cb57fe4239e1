"""Derives a service's values from others: programs that are evaluated once for all who ask.

A program is evaluated with a message of the service's own node, a few times a second, from the
newest values of healthy nodes. While nothing is held against anybody it is calibrated by that node.
"""
from dataclasses import dataclass, field, replace
from math import inf, isfinite, remainder, tau
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Set, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.codegen.program import Step, compile_program
from shsa_core.language.memory import MAX_GAP_S
from shsa_core.model.calibration import UNCALIBRATED, Calibration
from shsa_core.model.error import Error
from shsa_core.model.field import is_angle
from shsa_core.model.growth import Growth
from shsa_core.model.service import Deadlines, Service, Source
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_core.monitoring import settings
from shsa_core.monitoring.calibration import Calibrator


@dataclass
class Output:
    """A value that a program derives. `stated`: the error that it is expected to have.

    `derived`: its newest value, None: an input is missing. `learned`: a while ago; `calibration`:
    with the error that it has grown to while nobody measures: `growth`, None: somebody does.
    """

    source: Source
    stated: Optional[Error]
    integrates: bool
    calibrator: Optional[Calibrator] = None
    derived: Optional[float] = None
    learned: Calibration = UNCALIBRATED
    calibration: Calibration = UNCALIBRATED
    growth: Optional[Growth] = None

    def calibrate(self) -> None:
        """Learn gain and offset from now on."""
        if self.calibrator is None:
            angle = is_angle(self.source.provision.field)
            self.calibrator = Calibrator(self.stated.rms if self.stated else None, angle)

    def refresh(self, time: float) -> None:
        """Look at what was learned, and at how old it is."""
        if self.calibrator is None:
            return
        self.calibration = self.learned = self.calibrator.snapshot()
        if self.growth is not None and self.learned.error is not None:
            grown = self.growth.added(self.learned.error, self.calibrator.aged(time))
            self.calibration = replace(self.learned, error=grown)

    def compare(self, time: float, other: Optional["Output"]) -> None:
        """Look at its value, which nobody measures, and at what another derivation tells."""
        mine, its = self._told(time), None if other is None else other._told(time)
        if self.calibrator is None or self.derived is None:
            return
        apart = None
        if mine is not None and its is not None:
            angle = is_angle(self.source.provision.field)
            off = mine[0] - its[0]
            apart = remainder(off, tau) if angle else off, mine[1] + its[1]
        self.growth = self.growth or Growth(settings.GUARD_S, settings.SETTLING_S)
        self.growth.look(time, self.calibrator.beyond(self.derived), apart)

    def _told(self, time: float) -> Optional[Tuple[float, float]]:
        """Return the calibrated value, and its variance; None: not known."""
        if self.calibrator is None or self.derived is None:
            return None
        error = self.learned.error
        if error is None:
            return None
        return self.learned(self.derived), error.rms**2 + self.calibrator.aged(time)


@dataclass(eq=False)
class FollowedPlan:
    """The program of a plan for a service, evaluated while it `substitutes` or is a `witness`.

    `remembers`: it has to see every message. `rate`: evaluations a second. `doubtful`: an input is
    missing, or its newest value in doubt. `told`: calibrations of the outputs as told last.
    """

    service: str
    program: Program
    inputs: Tuple[Source, ...]
    outputs: Tuple[Output, ...]
    step: Step
    remembers: bool
    rate: float
    substitutes: bool = False
    witness: bool = False
    doubtful: bool = True
    looked: float = -inf
    told: Tuple[Calibration, ...] = ()

    def doubt(self) -> None:
        """Learn nothing from what was heard last."""
        for output in self.outputs:
            if output.calibrator is not None:
                output.calibrator.doubt()

    def learn(
        self, all_: Iterable["FollowedPlan"], measured: Mapping[str, float], time: float
    ) -> None:
        """Learn from what the service's own node measured."""
        for output in self.outputs:
            value, own = measured.get(output.source.property), output.calibrator
            if own is not None and output.derived is not None and value is not None:
                other = self.opinion(output, all_)
                its = None if other is None else other.calibrator
                own.confirmed = its is not None and its.confirms(own.pull)
                own.take(time, value, output.derived)
                output.growth = None

    def refresh(self, time: float) -> None:
        """Look at what was learned."""
        self.looked = time
        for output in self.outputs:
            output.refresh(time)

    def opinion(self, output: Output, all_: Iterable["FollowedPlan"]) -> Optional[Output]:
        """Return the same value by that calibrated plan which shares the fewest inputs."""
        own, found = set(self.inputs), []
        for number, plan in enumerate(all_):
            for each in () if plan is self or plan.doubtful else plan.outputs:
                error = each.calibration.error
                if each.source.property == output.source.property and error is not None:
                    found.append((len(own.intersection(plan.inputs)), error.rms, number, each))
        return min(found)[-1] if found else None


@dataclass
class _Heard:
    """The values that a service's own node told while healthy, by property, with their times.

    `sound`: nothing is held against its newest message. `read`: the properties that some program
    reads; `readers`: these programs.
    """

    values: Dict[str, Tuple[float, float]] = field(default_factory=dict)
    sound: bool = False
    read: Set[str] = field(default_factory=set)
    readers: Set[FollowedPlan] = field(default_factory=set)
    looked: float = -inf
    followed: List[FollowedPlan] = field(default_factory=list)


class Derivations:
    """Evaluates plans for the services of a SOM. Times in s."""

    def __init__(self, deadlines: Deadlines) -> None:
        self._deadlines = deadlines
        self._services: Dict[str, _Heard] = {}
        self._refreshed: List[FollowedPlan] = []

    def watch(self, som: Som, changed: Iterable[str]) -> None:
        """Evaluate what is followed on, but for services that have `changed`, and for witnesses."""
        for name in changed:
            self._services.pop(name, None)
        self._services = {s.name: self._services.get(s.name) or _Heard() for s in som}
        for heard in self._services.values():
            heard.read.clear()
            heard.readers.clear()
            for followed in heard.followed:
                followed.witness = False
            heard.followed = [each for each in heard.followed if self._goes_on(each)]
        for heard in self._services.values():
            for followed in heard.followed:
                self._read(followed)

    def concerns(self, service: Service) -> bool:
        """Tell if values of a service are read, or compared."""
        heard = self._services[service.name]
        return bool(heard.read or heard.followed)

    def made(self, plan: Plan) -> FollowedPlan:
        """Return what evaluates a plan: what is there already, or new. Raises ShsaError."""
        for each in self._services[plan.service].followed:
            if each.program == plan.program:
                return each
        period = plan.outputs[0].service.period or 0.0
        gap = max(MAX_GAP_S, settings.GAP_PERIODS * period)
        program = compile_program(plan.program.code, len(plan.inputs), len(plan.outputs), gap)
        integrates = [program.hidden or sum_ is not None for sum_ in program.integrals]
        pause = period if program.remembers else max(period, settings.SAMPLE_S)
        return FollowedPlan(
            plan.service,
            plan.program,
            plan.inputs,
            tuple(map(Output, plan.outputs, plan.errors, integrates)),
            program.step,
            program.remembers,
            1.0 / pause if pause else inf,
        )

    def follow(self, followed: FollowedPlan) -> None:
        """Evaluate a program from now on."""
        all_ = self._services[followed.service].followed
        if followed not in all_:
            all_.append(followed)
            self._read(followed)

    def leave(self, followed: FollowedPlan) -> None:
        """Evaluate a program no more, unless it is a witness: it substitutes nothing now."""
        followed.substitutes = False
        followed.doubt()
        all_ = self._services[followed.service].followed
        if followed in all_ and not followed.witness:
            all_.remove(followed)
            for source in followed.inputs:
                self._services[source.service.name].readers.discard(followed)

    def heard(self, service: Service, values: Mapping[str, float], time: float, good: bool) -> bool:
        """Take what the node of a service says; tell if all its programs were evaluated.

        `good`: the message is, and its node is healthy.
        """
        heard = self._services[service.name]
        if good:
            heard.values.update((name, (time, values[name])) for name in heard.read & values.keys())
        looks = not 0.0 <= time - heard.looked < settings.SAMPLE_S
        if looks:
            heard.looked = time
        for each in heard.followed:
            if looks or each.remembers:
                self._evaluate(each, time)
        return looks

    def unmeasured(self, service: Service, time: float) -> None:
        """A substitute speaks for a service: see how far its derivations can be believed."""
        all_ = self._services[service.name].followed
        if self.heard(service, {}, time, False):
            for each in all_:
                for output in () if each.doubtful else each.outputs:
                    output.compare(time, each.opinion(output, all_))
                self._refresh(each, time)

    def judged(
        self, service: Service, values: Mapping[str, float], time: float, sound: bool, looked: bool
    ) -> None:
        """Learn from a message; `sound`: nothing is held against it or against its node."""
        heard = self._services[service.name]
        heard.sound = sound
        if not sound:
            for each in (*heard.followed, *heard.readers):
                each.doubt()
        elif looked:
            for each in heard.followed:
                if each.doubtful:
                    each.doubt()
                    continue
                each.learn(heard.followed, values, time)
                self._refresh(each, time)

    def _refresh(self, followed: FollowedPlan, time: float) -> None:
        if time - followed.looked >= settings.REFRESH_S:
            followed.refresh(time)
            self._refreshed.append(followed)

    def derived(self, service: Service, property: str, time: float) -> Iterator[float]:
        """Yield what sound inputs tell now of a value of a service."""
        for followed in self._services[service.name].followed:
            for output in followed.outputs:
                if output.source.property == property and not followed.remembers:
                    self._evaluate(followed, time)
                    if output.derived is not None and not followed.doubtful:
                        yield output.derived

    def refreshed(self) -> List[FollowedPlan]:
        """Return the programs of which new calibrations are known since the last call."""
        refreshed, self._refreshed = self._refreshed, []
        return refreshed

    def _goes_on(self, followed: FollowedPlan) -> bool:
        there = all(source.service.name in self._services for source in followed.inputs)
        return followed.substitutes and there

    def _read(self, followed: FollowedPlan) -> None:
        for source in followed.inputs:
            heard = self._services[source.service.name]
            heard.read.add(source.property)
            heard.readers.add(followed)

    def _evaluate(self, followed: FollowedPlan, time: float) -> None:
        known = [self._value(source, time) for source in followed.inputs]
        inputs = [value for value in known if value is not None]
        derived = followed.step(inputs, time) if len(inputs) == len(known) else None
        sound = all(self._services[source.service.name].sound for source in followed.inputs)
        followed.doubtful = derived is None or not sound
        for number, output in enumerate(followed.outputs):
            value = None if derived is None else derived[number]
            output.derived = value if value is not None and isfinite(value) else None

    def _value(self, source: Source, time: float) -> Optional[float]:
        """Return the newest value of a source; None if it is stale."""
        found = self._services[source.service.name].values.get(source.property)
        deadline = self._deadlines.of(source.service)
        if found is None or (deadline is not None and time - found[0] > deadline):
            return None
        return found[1]

"""Derives a service's values from others: programs that are evaluated once for all who ask.

A program is evaluated with a message of the service's own node, a few times a second, from the
newest values of healthy nodes. While nothing is held against anybody it is calibrated by that node.
"""
from dataclasses import dataclass, field, replace
from math import inf
from typing import Dict, Iterable, Iterator, List, Mapping, Optional, Set, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.codegen.program import CompiledProgram, compile_periodic
from shsa_core.language.memory import sample_times
from shsa_core.model.calibration import UNCALIBRATED, Calibration, Growth
from shsa_core.model.error import Error
from shsa_core.model.field import difference, is_angle
from shsa_core.model.service import Deadlines, Service, Source
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_core.derivations import settings
from shsa_core.derivations.calibrator import Calibrator
from shsa_core.search.derivation import Derivation


@dataclass(eq=False)
class Output:
    """A value that a program derives. `stated`: the error that it is expected to have.

    `calibrates`: it learns gain and offset. `derived`: its newest value, None: an input is missing.
    `learned`: a while ago; `calibration`: with the error that it has grown to while nobody
    measures: `growth`, None: somebody does; `told`: as others know it.
    """

    source: Source
    derivation: Derivation
    stated: Optional[Error]
    integrates: bool
    calibrates: bool = False
    calibrator: Calibrator = field(default_factory=Calibrator)
    derived: Optional[float] = None
    learned: Calibration = UNCALIBRATED
    calibration: Calibration = UNCALIBRATED
    told: Calibration = UNCALIBRATED
    growth: Optional[Growth] = None

    def calibrate(self) -> None:
        """Learn gain and offset from now on."""
        if not self.calibrates:
            self.calibrates = True
            angle = is_angle(self.source.provision.field)
            self.calibrator = Calibrator(self.stated.rms if self.stated else None, angle)

    def learn(self, time: float, measured: float, other: Optional["Output"]) -> None:
        """Learn from what was measured, while another derivation confirms it."""
        own = self.calibrator
        if self.calibrates and self.derived is not None:
            own.confirmed = other is not None and other.calibrator.confirms(own.pull)
            own.take(time, measured, self.derived)
            self.growth = None

    def refresh(self, time: float) -> None:
        """Look at what was learned, and at how old it is."""
        self.calibration = self.learned = self.calibrator.snapshot()
        if self.growth is not None and self.learned.error is not None:
            grown = self.growth.added(self.learned.error, self.calibrator.aged(time))
            self.calibration = replace(self.learned, error=grown)

    def compare(self, time: float, other: Optional["Output"]) -> None:
        """Look at its value, which nobody measures, and at what another derivation tells."""
        mine, its = self._told(time), None if other is None else other._told(time)
        if self.derived is None:
            return
        apart = None
        if mine is not None and its is not None:
            off = difference(mine[0], its[0], is_angle(self.source.provision.field))
            apart = off, mine[1] + its[1]
        self.growth = self.growth or Growth(settings.GUARD_S, settings.SETTLING_S)
        self.growth.look(time, self.calibrator.beyond(self.derived), apart)

    def _told(self, time: float) -> Optional[Tuple[float, float]]:
        """Return the calibrated value, and its variance; None: not known."""
        error = self.learned.error
        if self.derived is None or error is None:
            return None
        return self.learned(self.derived), error.rms**2 + self.calibrator.aged(time)


@dataclass(eq=False)
class FollowedPlan:
    """A plan for a service, evaluated while it `substitutes` or is a `witness`.

    `doubtful`: an input is missing, or its newest value in doubt.
    """

    plan: Plan
    outputs: Tuple[Output, ...]
    compiled: CompiledProgram
    substitutes: bool = False
    witness: bool = False
    doubtful: bool = True
    refreshed: float = -inf

    @property
    def key(self) -> Tuple[str, Program]:
        """Its service and program."""
        return self.plan.service, self.plan.program

    @property
    def reads(self) -> Set[str]:
        """The services that it reads."""
        return {source.service.name for source in self.plan.inputs}

    @property
    def is_followed(self) -> bool:
        """True while it is evaluated."""
        return self.substitutes or self.witness

    @property
    def rate(self) -> float:
        """Evaluations a second."""
        period = self.plan.outputs[0].service.period or 0.0
        pause = period if self.compiled.remembers else max(period, settings.SAMPLE_S)
        return 1.0 / pause if pause else inf

    def doubt(self) -> None:
        """Learn nothing from what was heard last."""
        for output in self.outputs:
            output.calibrator.doubt()

    def opinion(self, output: Output, all_: Iterable["FollowedPlan"]) -> Optional[Output]:
        """Return the same value by that calibrated plan which shares the fewest inputs."""
        own, found = set(self.plan.inputs), []
        for number, each in enumerate(all_):
            for other in () if each is self or each.doubtful else each.outputs:
                error = other.calibration.error
                if other.source.property == output.source.property and error is not None:
                    shared = len(own.intersection(each.plan.inputs))
                    found.append((shared, error.rms, number, other))
        return min(found)[-1] if found else None


@dataclass
class _Heard:
    """One service as it is heard, and the `plans` for it, which are kept while they rest.

    `values`: what its own node told while healthy, by property, with their times. `measured`: all
    of its newest message, with which the plans were evaluated; None: they were not. `sound`:
    nothing is held against that message. `readers`: the plans that read it. `evaluated`: when, and
    `compared`: when last while its node was not there.
    """

    service: Service
    values: Dict[str, Tuple[float, float]] = field(default_factory=dict)
    measured: Optional[Mapping[str, float]] = None
    sound: bool = False
    evaluated: float = -inf
    compared: float = -inf
    readers: Set[FollowedPlan] = field(default_factory=set)
    plans: List[FollowedPlan] = field(default_factory=list)

    @property
    def followed(self) -> List[FollowedPlan]:
        """The plans that are evaluated."""
        return [plan for plan in self.plans if plan.is_followed]


class Derivations:
    """Evaluates plans for the services of a SOM. Times in s."""

    def __init__(self, deadlines: Deadlines) -> None:
        self._deadlines = deadlines
        self._services: Dict[str, _Heard] = {}
        self._refreshed: List[FollowedPlan] = []
        self._gone: List[FollowedPlan] = []

    def watch(self, som: Som) -> None:
        """Go on with the services of `som`, but for those that have changed.

        Nobody is a witness any more.
        """
        known = self._services
        plans = [plan for heard in known.values() for plan in heard.plans]
        goes_on = {s.name for s in som if s.name in known and known[s.name].service == s}
        same = {name: replace(known[name], readers=set(), plans=[]) for name in goes_on}
        self._services = {each.name: same.get(each.name) or _Heard(each) for each in som}
        for followed in plans:
            followed.witness = False
            if followed.plan.service in goes_on and followed.reads <= self._services.keys():
                self._keep(followed)
            else:
                self._gone.append(followed)
        self._refreshed = [each for each in self._refreshed if each not in self._gone]

    def _keep(self, followed: FollowedPlan) -> None:
        self._services[followed.plan.service].plans.append(followed)
        for name in followed.reads:
            self._services[name].readers.add(followed)

    def give_up(self, followed: FollowedPlan) -> None:
        """Forget a plan, and what it has learned."""
        self._gone.append(followed)
        self._services[followed.plan.service].plans.remove(followed)
        for name in followed.reads:
            self._services[name].readers.discard(followed)

    def concerns(self, service: Service) -> bool:
        """Tell if values of a service are read, or compared."""
        heard = self._services.get(service.name)
        return heard is not None and bool(heard.readers or heard.plans)

    def plans(self, service: Optional[str] = None) -> List[FollowedPlan]:
        """Return the plans for a service, the newest last; None: those for all."""
        names = self._services if service is None else (service,)
        return [plan for name in names for plan in self._services[name].plans]

    def made(self, plan: Plan) -> FollowedPlan:
        """Return what evaluates a plan: what is there already, or new. Raises ShsaError."""
        reads = [(source.service.name, source.node) for source in plan.inputs]
        for each in self._services[plan.service].plans:
            same = [(source.service.name, source.node) for source in each.plan.inputs] == reads
            if same and each.plan.program == plan.program:  # the same may read other nodes
                each.plan = plan  # by the numbers of now
                for output, derivation, stated in zip(each.outputs, plan.derivations, plan.errors):
                    output.derivation, output.stated = derivation, stated
                return each
        period, code = plan.outputs[0].service.period, plan.program.code
        inputs = [(each.provision.field, each.service.period) for each in plan.inputs]
        program = compile_periodic(code, inputs, len(plan.outputs), period)
        integrates = [program.hidden or sum_ is not None for sum_ in program.integrals]
        outputs = tuple(map(Output, plan.outputs, plan.derivations, plan.errors, integrates))
        made = FollowedPlan(plan, outputs, program)
        self._keep(made)
        return made

    def heard(self, service: Service, values: Mapping[str, float], time: float, good: bool) -> bool:
        """Take what the node of a service says; tell if all its plans were evaluated.

        `good`: the message is, and its node is healthy.
        """
        heard = self._services[service.name]
        if good:
            heard.values.update((name, (time, value)) for name, value in values.items())
        due = self._evaluate_all(heard, heard.evaluated, time)
        heard.measured, heard.evaluated = (values, time) if due else (None, heard.evaluated)
        return due

    def _evaluate_all(self, heard: _Heard, last: float, time: float) -> bool:
        """Evaluate what is due since the `last` time; tell if all plans are."""
        due = not 0.0 <= time - last < settings.SAMPLE_S
        for each in heard.followed:
            if due or each.compiled.remembers:
                self._evaluate(each, time)
        return due

    def unmeasured(self, service: Service, time: float) -> None:
        """Its node is not there: see how far derivations of a service can be believed."""
        heard = self._services[service.name]
        heard.values.clear()  # if it is event-driven they would be fresh for ever
        if self._evaluate_all(heard, heard.compared, time):
            heard.compared, followed = time, heard.followed
            for each in followed:
                for output in () if each.doubtful else each.outputs:
                    output.compare(time, each.opinion(output, followed))
                self._refresh(each, time)

    def judged(self, service: Service, time: float, sound: bool) -> None:
        """Learn from what was heard last; `sound`: nothing is held against it or its node."""
        heard = self._services[service.name]
        heard.sound = sound
        if not sound:
            for each in (*heard.plans, *heard.readers):
                each.doubt()
        elif heard.measured is not None:
            followed = heard.followed
            for each in followed:
                for output in () if each.doubtful else each.outputs:
                    measured = heard.measured.get(output.source.property)
                    if measured is not None:
                        output.learn(time, measured, each.opinion(output, followed))
                self._refresh(each, time)

    def _refresh(self, plan: FollowedPlan, time: float) -> None:
        if time - plan.refreshed >= settings.REFRESH_S:
            plan.refreshed = time
            for output in plan.outputs:
                output.refresh(time)
            self._refreshed.append(plan)

    def derived(self, service: Service, property: str, time: float) -> Iterator[float]:
        """Yield what sound inputs tell now of a value of a service."""
        for plan in self._services[service.name].followed:
            for output in plan.outputs:
                if output.source.property == property and not plan.compiled.remembers:
                    self._evaluate(plan, time)
                    if output.derived is not None and not plan.doubtful:
                        yield output.derived

    def news(self) -> Tuple[List[FollowedPlan], List[FollowedPlan]]:
        """Return the plans with new calibrations, and those given up, since the last call."""
        news, self._refreshed, self._gone = (self._refreshed, self._gone), [], []
        return news

    def _evaluate(self, followed: FollowedPlan, time: float) -> None:
        known = [self._value(source, time) for source in followed.plan.inputs]
        came, inputs = zip(*filter(None, known)) if any(known) else ((), ())
        at = sample_times(came, time)
        derived = followed.compiled.step(inputs, time, at) if len(inputs) == len(known) else None
        sound = all(self._services[name].sound for name in followed.reads)
        followed.doubtful = derived is None or not sound
        for number, output in enumerate(followed.outputs):
            value = None if derived is None else derived[number]
            output.derived = value if value is not None and abs(value) < settings.LARGEST else None

    def _value(self, source: Source, time: float) -> Optional[Tuple[Optional[float], float]]:
        """Return the newest value of a source and when it came, unless it holds; None: stale."""
        found = self._services[source.service.name].values.get(source.property)
        deadline = self._deadlines.of(source.service)
        if found is None or (deadline is not None and time - found[0] > deadline):
            return None
        return (None if deadline is None else found[0]), found[1]

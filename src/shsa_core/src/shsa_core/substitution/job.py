"""A program at work: what it computes from, and what it yielded last."""
import math
from typing import Iterable, Optional, Tuple

from shsa_core.codegen.program import compile_program
from shsa_core.errors import ShsaError
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.substitution.settings import Settings

Words = Tuple[Tuple[Tuple[str, ...], ...], str, Tuple[Tuple[str, ...], ...]]


class Job:
    """The program of one row of the table of substitutions.

    `remembers`: whether it must be evaluated at every step, also if nobody wants what it yields.
    `latest`: what it yielded last, None if nothing; `gave_out`: it has had no value for so long
    since, or since it was taken, that another law may be better. Raises ShsaError if the program is
    not valid, or if its outputs are not of one topic.
    """

    def __init__(self, row: Substitution, settings: Settings) -> None:
        if len(row.topics) != 1:
            named = ", ".join(row.topics) or "none"
            raise ShsaError(f"its outputs must be fields of one topic, not of {named}")
        self._settings = settings
        self._take(row)
        program = compile_program(row.code, len(row.inputs), len(row.outputs), max_gap=self._gap)
        self._step = program.step
        self._integrals = program.integrals
        self._unstarted = {
            signal.field for signal, sum_ in zip(row.outputs, program.integrals) if sum_ is not None
        }
        if not row.service and row.publishing:
            self._unstarted.clear()  # somebody started it by hand: from 0, as documented
        self.hidden_integral = program.hidden
        self.remembers = program.remembers
        self._stepped = -math.inf
        self.latest: Optional[Tuple[float, ...]] = None
        self._misses = 0
        self._allowed = settings.first_misses

    def _take(self, row: Substitution) -> None:
        self.inputs = row.inputs
        self.outputs = row.outputs
        self.topic = row.topics[0]
        self.period = row.outputs[0].period
        self._calibrates = any(each.gain != 1.0 or each.offset for each in row.outputs)
        self._words = words(row)

    @property
    def _gap(self) -> float:
        if self.period is None:
            return math.inf
        return max(self._settings.shortest_gap_s, self._settings.gap_periods * self.period)

    @property
    def gave_out(self) -> bool:
        """Whether another law may be better now."""
        return self._misses >= self._allowed

    def follow(self, row: Substitution) -> bool:
        """Go on with the numbers of `row`; whether that is possible: it must be the same program.

        What the program remembers, filters and the like, stays.
        """
        if words(row) != self._words:
            return False
        self._take(row)
        return True

    @property
    def integrates(self) -> bool:
        """Whether it sums up, and so is as good as where it last started from."""
        return self.hidden_integral or any(sum_ is not None for sum_ in self._integrals)

    @property
    def unstarted(self) -> Tuple[str, ...]:
        """The fields of its outputs that are integrals from nobody knows where."""
        return tuple(sorted(self._unstarted))

    def start(self, values: Iterable[Tuple[str, float]]) -> None:
        """Have integrals start at the last good values of the fields that they are written to."""
        known = {field: value for field, value in values if math.isfinite(value)}
        for signal, sum_ in zip(self.outputs, self._integrals):
            if sum_ is not None and signal.field in known:
                sum_[0] = known[signal.field]
                self._unstarted.discard(signal.field)
                self.latest = None

    @property
    def published(self) -> Tuple[Tuple[str, float], ...]:
        """What it yielded last, by field."""
        fields = (signal.field for signal in self.outputs)
        return tuple(zip(fields, self.latest or ()))

    def evaluate(self, values: Tuple[float, ...], now: float) -> None:
        """Set `latest` to what the program yields of its inputs' `values`.

        Two evaluations in close succession would take a derivative over next to no time: the second
        one is left out.
        """
        soonest = self._stepped + self._settings.shortest_step_share * (self.period or 0.0)
        if self.latest is None or now >= soonest:
            self.latest = self._calibrated(self._step(values, now))
            self._stepped = now
            if self.latest is None:
                self._misses += 1
            else:
                self._misses, self._allowed = 0, self._settings.misses

    def _calibrated(self, values: Optional[Tuple[float, ...]]) -> Optional[Tuple[float, ...]]:
        """What the program yields, by the gains and offsets of the row."""
        if values is None or not self._calibrates:
            return values
        found = tuple(s.gain * value + s.offset for s, value in zip(self.outputs, values))
        return found if all(map(math.isfinite, found)) else None


def words(row: Substitution) -> Words:
    """What makes the program of a row: code, fields and types.

    The signals' periods, deadlines, gains and offsets are no part of it.
    """

    def names(signals: Tuple[Signal, ...]) -> Tuple[Tuple[str, ...], ...]:
        return tuple((each.topic, each.field, each.type, each.node) for each in signals)

    return names(row.inputs), row.code, names(row.outputs)

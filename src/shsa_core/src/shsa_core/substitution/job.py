"""A program at work: what it computes from, and what it yielded last."""
import math
from typing import Optional, Tuple

from shsa_core.codegen.program import compile_program
from shsa_core.errors import ShsaError
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.substitution.settings import Settings

Words = Tuple[Tuple[Tuple[str, ...], ...], str, Tuple[Tuple[str, ...], ...]]


class Job:
    """The program of one row of the table of substitutions.

    `latest`: what it yielded last, None if nothing. Raises ShsaError if the program is not valid,
    or if its outputs are not of one topic.
    """

    def __init__(self, row: Substitution, settings: Settings) -> None:
        if len(row.topics) != 1:
            named = ", ".join(row.topics) or "none"
            raise ShsaError(f"its outputs must be fields of one topic, not of {named}")
        self._settings = settings
        self._take(row)
        program = compile_program(row.code, len(row.inputs), len(row.outputs), max_gap=self._gap)
        self._step = program.step
        self._stepped = -math.inf
        self.latest: Optional[Tuple[float, ...]] = None

    def _take(self, row: Substitution) -> None:
        self.inputs = row.inputs
        self.outputs = row.outputs
        self.topic = row.topics[0]
        self.period = row.outputs[0].period
        self._words = words(row)

    @property
    def _gap(self) -> float:
        if self.period is None:
            return math.inf
        return max(self._settings.shortest_gap_s, self._settings.gap_periods * self.period)

    def follow(self, row: Substitution) -> bool:
        """Go on with the numbers of `row`; whether that is possible: it must be the same program.

        What the program remembers, filters and the like, stays.
        """
        if words(row) != self._words:
            return False
        self._take(row)
        return True

    def evaluate(self, values: Tuple[float, ...], now: float) -> None:
        """Set `latest` to what the program yields of its inputs' `values`.

        Two evaluations in close succession would take a derivative over next to no time: the second
        one is left out.
        """
        soonest = self._stepped + self._settings.shortest_step_share * (self.period or 0.0)
        if self.latest is None or now >= soonest:
            self.latest = self._step(values, now)
            self._stepped = now


def words(row: Substitution) -> Words:
    """What makes the program of a row: code, fields and types.

    The signals' periods and deadlines are no part of it.
    """

    def names(signals: Tuple[Signal, ...]) -> Tuple[Tuple[str, ...], ...]:
        return tuple((each.topic, each.field, each.type, each.node) for each in signals)

    return names(row.inputs), row.code, names(row.outputs)

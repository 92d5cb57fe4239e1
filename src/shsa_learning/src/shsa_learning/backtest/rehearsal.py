"""A derivation's program run over recorded data, as its substitute would have run."""
import math
from itertools import repeat
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from shsa_core.codegen.generator import inputs_of
from shsa_core.codegen.program import compile_periodic
from shsa_core.model.service import Deadlines, Source
from shsa_core.model.substitution import Program
from shsa_core.search.derivation import Derivation
from shsa_core.substitution.settings import SHORTEST_SHARE
from shsa_learning.recordings.recording import Recording, Series, held, measured_at, sample_times_of


class Played(NamedTuple):
    """The output of a program beside what was measured: (n,) each, at `time` in s.

    NaN in `values` where it had no output, in `measured` where nothing was.
    """

    time: np.ndarray
    values: np.ndarray
    measured: np.ndarray


def recorded(recording: Recording, source: Source) -> Optional[Series]:
    """Return the series of a source in a recording; None if there is none."""
    found = (s for s in recording.of(source.property) if s.service == source.service.name)
    return next(found, None)


class Rehearsal:
    """A recording in which `target` was measured, while its substitutes work beside it.

    They are evaluated when it was measured, and once a period where it was not; the newest inputs
    count that had come by then and are not stale. `time` in s and what was `measured`: (n,) each.
    """

    def __init__(self, recording: Recording, target: Source):
        series = recorded(recording, target)
        assert series is not None, "what was not measured cannot be compared"
        self._recording, self._target = recording, target.service
        self._period = target.service.period or series.interval
        self._soonest = SHORTEST_SHARE * self._period
        self._held: Dict[Source, np.ndarray] = {}
        self.time = _ticks(series.time, self._period)
        place = np.searchsorted(self.time, series.time)
        self.measured = np.full(len(self.time), np.nan)
        self.measured[place] = np.where(np.isfinite(series.values), series.values, np.nan)

    def play(self, derivation: Derivation, program: Program) -> Played:
        """Run the program of a derivation. An integral begins where the target was."""
        return self.run(inputs_of([derivation]), program)

    def run(self, sources: Sequence[Source], program: Program, place: int = 0) -> Played:
        """Run a program that reads these sources; return its output at `place`."""
        n_outputs = len(program.outputs)
        inputs = [(each.provision.field, each.service.period) for each in sources]
        compiled = compile_periodic(program.code, inputs, n_outputs, self._target.period)
        columns = [self._inputs(source) for source in sources]
        known = np.isfinite(self.measured)
        sum_ = compiled.integrals[place] if compiled.integrals else None
        if sum_ is not None and known.any():
            sum_[0] = float(self.measured[known][0])
        values = np.full(len(self.time), np.nan)
        rows = np.stack(columns, axis=1) if columns else np.zeros((len(self.time), 0))
        there = np.flatnonzero(np.isfinite(rows).all(axis=1))
        step, soonest = compiled.step, self._soonest
        last, latest = -math.inf, math.nan
        found: List[float] = []
        time = self.time[there]
        came = [self._moments(source, time) for source in sources]
        at = sample_times_of(came, time) if compiled.timed else repeat(())
        for now, row, times in zip(time.tolist(), rows[there].tolist(), at):
            if latest != latest or now - last >= soonest:
                output = step(row, now, times)
                latest = math.nan if output is None else output[place]
                last = now
            found.append(latest)
        values[there] = found
        return Played(self.time, values, self.measured)

    def _moments(self, source: Source, time: np.ndarray) -> np.ndarray:
        """Return when the values of an input were measured; NaN: they hold."""
        series = recorded(self._recording, source)
        if series is None or source.service.period is None:
            return np.full(len(time), np.nan)
        return measured_at(series, time)

    def _inputs(self, source: Source) -> np.ndarray:
        if source not in self._held:
            series = recorded(self._recording, source)
            deadline = Deadlines().of(source.service)
            age = math.inf if deadline is None else deadline
            nothing = np.full(len(self.time), np.nan)
            self._held[source] = nothing if series is None else held(series, self.time, age)
        return self._held[source]


def _ticks(time: np.ndarray, period: float) -> np.ndarray:
    """Return the times of a series (s), and once a period in its gaps."""
    gaps = np.flatnonzero(np.diff(time) > 2.0 * period).tolist() if period > 0.0 else []
    more: List[np.ndarray] = [
        np.arange(time[k] + period, time[k + 1] - 0.5 * period, period) for k in gaps
    ]
    ticks: np.ndarray = np.sort(np.concatenate([time, *more]))
    return ticks


def joined(parts: Sequence[Played]) -> Tuple[np.ndarray, np.ndarray]:
    """Return outputs and measurements of all recordings, where something was measured."""
    values = np.concatenate([part.values[np.isfinite(part.measured)] for part in parts])
    measured = np.concatenate([part.measured[np.isfinite(part.measured)] for part in parts])
    return values, measured

"""Every derivation of a property on recorded data: what it errs, and what was expected of it."""
import math
from dataclasses import dataclass
from itertools import islice
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from scipy import stats

from shsa_core.codegen.plans import Plan, plan_sources, program_of
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import GenerationError, NoSubstitute
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_learning.backtest.rehearsal import Played, Rehearsal, recorded
from shsa_learning.backtest.scores import Score, covered, score
from shsa_learning.recordings.recording import Recording
from shsa_learning.substitutes import substitutes

LEAST_RANKED = 3
"""Derivations: of fewer there is no rank correlation."""

Watch = Callable[[Iterable[Any], int, str], Iterable[Any]]
"""Passes work on and shows how far it is: the work, how much it is, what it is of."""


def unwatched(work: Iterable[Any], _total: int, _what: str) -> Iterable[Any]:
    """Shows nothing."""
    return work


@dataclass(frozen=True, eq=False)
class Trial:
    """A derivation on the recordings.

    `place`: which it is by its quality, from 0; `score`: None where it had no output; `predicted`:
    its expected error, None: not known; `covered`: the share of points that err no more than the
    predicted p95.
    """

    place: int
    derivation: Derivation
    program: Program
    quality: float
    predicted: Optional[Error]
    score: Optional[Score]
    covered: Optional[float]

    @property
    def relations(self) -> Tuple[str, ...]:
        """The relations it uses."""
        return self.derivation.relations()

    @property
    def rank(self) -> Tuple[float, int]:
        """Return the key by which trials are sorted, best first."""
        return math.inf if self.score is None else self.score.charged, self.place


class NotExecutable(NamedTuple):
    """A derivation of which no program can be made, and why."""

    relations: Tuple[str, ...]
    why: str


@dataclass(frozen=True, eq=False)
class Ranking:
    """A property as one service measured it, and all that derives it: `trials`, best first.

    `chosen`: what healing takes; None if there are no trials. `baseline`: the rms of who always
    says the mean of what was measured; `seconds` and `points` of that. `complete`: nothing else
    derives it from what was recorded. `by_prediction`, `by_quality`: the rank correlations of the
    real error with the predicted one, and with 1 - quality.
    """

    target: Source
    trials: Tuple[Trial, ...]
    chosen: Optional[Trial]
    refused: Tuple[NotExecutable, ...]
    complete: bool
    baseline: float
    seconds: float
    points: int
    by_prediction: Optional[float]
    by_quality: Optional[float]

    @property
    def best(self) -> Optional[Trial]:
        """The trial that healing should choose."""
        return next((trial for trial in self.trials if trial.score is not None), None)


class Backtest:
    """Derivations of properties on recordings, from the services that were recorded."""

    def __init__(self, ontology: Ontology, som: Som, recordings: Sequence[Recording]) -> None:
        self._ontology = ontology
        self._som = som
        self._recordings = recordings
        self._predictor = predictor(ontology, som.sources)
        self._there = [
            source
            for source in som.sources
            if any(recorded(recording, source) is not None for recording in recordings)
        ]

    @property
    def unrecorded(self) -> Tuple[Source, ...]:
        """The sources of the SOM of which there is no recording."""
        return tuple(source for source in self._som.sources if source not in self._there)

    def targets(self, property: Optional[str] = None) -> Tuple[Source, ...]:
        """Return the measured sources whose loss is tried: of a property, or of all.

        Those of needed services, or the first one where none is needed.
        """
        names = dict.fromkeys(source.property for source in self._there)
        found: List[Source] = []
        for name in names if property is None else [property]:
            own = [source for source in self._there if source.property == name]
            found += [source for source in own if source.service.needed] or own[:1]
        return tuple(found)

    def rank(self, target: Source, limit: int, watch: Watch = unwatched) -> Ranking:
        """Try every derivation of a measured source, `limit` at most, on all recordings of it."""
        stages = self._stages(target)
        sources = self._usable(target)
        planned = self._planned(target, sources)
        listed, refused, complete = self._derivations(target, sources, limit)
        if planned is not None:
            listed.setdefault(planned.program, (planned.derivations[0], planned.quality))
        derivations = [derivation for derivation, _ in listed.values()]
        expected: List[Optional[Error]] = [None] * len(derivations)
        if self._predictor is not None:
            expected = self._predictor.of(derivations)
        questions = list(zip(listed, listed.values(), expected))
        trials: List[Trial] = []
        for program, (derivation, quality), error in watch(questions, len(listed), target.property):
            parts = [stage.play(derivation, program) for stage in stages]
            scored = score(parts)
            known = scored is not None and error is not None and error.p95 is not None
            share = covered(parts, error.p95) if known else None  # type: ignore
            trial = Trial(len(trials), derivation, program, quality, error, scored, share)
            trials.append(trial)
        chosen = (t for t in trials if planned is not None and t.program == planned.program)
        measured = [stage.measured[np.isfinite(stage.measured)] for stage in stages]
        return Ranking(
            target,
            tuple(sorted(trials, key=lambda trial: trial.rank)),
            next(chosen, None),
            tuple(refused),
            complete,
            float(np.std(np.concatenate(measured))),
            sum(float(stage.time[-1] - stage.time[0]) for stage in stages),
            sum(map(len, measured)),
            *_correlations(trials),
        )

    def replay(self, target: Source, trial: Trial) -> List[Played]:
        """Return the output of a trial beside what was measured, one part a recording."""
        return [stage.play(trial.derivation, trial.program) for stage in self._stages(target)]

    def _stages(self, target: Source) -> List[Rehearsal]:
        return [
            Rehearsal(recording, target)
            for recording in self._recordings
            if recorded(recording, target) is not None
        ]

    def _usable(self, target: Source) -> List[Source]:
        """Return the sources that a plan may read: as in healing, none that fails with the target.

        The node of the target is lost with it in any case.
        """
        service = target.service
        lost = {service.name, service.node}
        there = [source for source in self._there if lost.isdisjoint(source.names)]
        for causes in service.avoided:
            apart = [source for source in there if set(causes).isdisjoint(source.names)]
            if next(substitutes(self._ontology, apart, target.property), None) is not None:
                return apart
        return there

    def _planned(self, target: Source, sources: Sequence[Source]) -> Optional[Plan]:
        """Return the trial that healing would choose; None if nothing can be executed."""
        table = SourceTable(self._ontology.network, sources)
        question = self._ontology, [target], table
        try:
            return plan_sources(*question, predictor=self._predictor)
        except (NoSubstitute, GenerationError):
            return None

    def _derivations(
        self, target: Source, sources: Sequence[Source], limit: int
    ) -> Tuple[Dict[Program, Tuple[Derivation, float]], List[NotExecutable], bool]:
        """Yield the derivations of the target with their quality, best first; each program once."""
        found: Dict[Program, Tuple[Derivation, float]] = {}
        refused: List[NotExecutable] = []
        listing = (each for each, _ in substitutes(self._ontology, sources, target.property))
        for each in islice(listing, limit):
            try:
                program = program_of(self._ontology, [each.derivation], [target])
            except GenerationError as error:
                refused.append(NotExecutable(each.derivation.relations(), str(error)))
                continue
            found.setdefault(program, (each.derivation, each.quality))
        return found, refused, next(listing, None) is None


def _correlations(trials: Sequence[Trial]) -> Tuple[Optional[float], Optional[float]]:
    """Return how the real error ranks with the predicted one, and with 1 - quality."""
    pairs = [(trial, trial.score.error.rms) for trial in trials if trial.score is not None]
    known = [(trial.predicted.rms, rms) for trial, rms in pairs if trial.predicted is not None]
    return _spearman(known), _spearman([(1.0 - trial.quality, rms) for trial, rms in pairs])


def _spearman(pairs: Sequence[Tuple[float, float]]) -> Optional[float]:
    if len(pairs) < LEAST_RANKED or any(len(set(column)) == 1 for column in zip(*pairs)):
        return None
    return float(stats.spearmanr(*zip(*pairs))[0])

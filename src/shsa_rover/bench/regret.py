"""Every property lost on unseen drives: what is chosen for it, and what had been best.

Before that the monitor calibrates what it follows, and the choice knows the errors that it tells.
"""
from dataclasses import dataclass, replace
from typing import Iterator, List, Optional, Tuple

import numpy as np

from derived import Columns
from shsa_core.codegen.choice import compare
from shsa_core.codegen.generator import generate
from shsa_core.codegen.prediction import predictor
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.planning.planner import Calibrations
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_rover.dataset import PERIOD_S, Dataset
from stated import START_S, Robot
from witnesses import messages

CALIBRATED_S, SETTLED_S = 120.0, 60.0
"""Before the loss; of that filters and integrals see the last part."""
THERE = 0.5
"""Of the moments at which a derivation must have a value to be the best."""


@dataclass(frozen=True)
class Regret:
    """The rms errors of a property in one drive, in its unit: of what was chosen, and the best.

    They are of what would be published, calibrated where that is known.
    """

    world: str
    lost: str
    chosen_by: str
    chosen: float
    best_by: str
    best: float

    @property
    def ratio(self) -> float:
        """By how much more the choice erred."""
        return self.chosen / self.best if self.best > 0.0 else 1.0


def regrets(
    world: str, data: Dataset, ontology: Ontology, som: Som, seconds: float
) -> Iterator[Regret]:
    """Yield every property with a known truth that can be derived without the service it has."""
    rows = min(len(data.time), round(seconds / PERIOD_S))
    lost_at = min(round(CALIBRATED_S / PERIOD_S), 2 * rows // 3)
    begin = max(0, lost_at - round(SETTLED_S / PERIOD_S))
    measured = {path: column[begin:rows] for path, column in data.measured.items()}
    columns = Columns(ontology, data.time[begin:rows], measured)
    calibrations = _calibrated(data, ontology, som, lost_at)
    network, predicted = ontology.network, predictor(ontology, som.sources)
    assert predicted is not None
    for name in sorted(set(ontology.properties) & set(data.truth)):
        lost = _lost(som, name)
        errors_of = calibrations.knowing(lost[0], predicted) if lost else predicted
        table = SourceTable(network, som.sources).excluding(lost)
        usable = network.executable
        compared, _ = compare(table, usable, network.number(name), errors_of)
        truth = data.truth[name][lost_at:rows]
        found: List[Tuple[float, str]] = []
        for derivation in (rated.derivation for rated in compared):
            values = columns.of(derivation)[lost_at - begin :]
            program = generate([(derivation, name)], ontology.constants)
            for calibration in calibrations.of(lost[0], program) if lost else ():
                values = calibration.gain * values + calibration.offset
            error = _rms(values - truth)
            found.append((error if error is not None else np.inf, _words(derivation)))
        if found and np.isfinite(found[0][0]):
            best = min(found)
            yield Regret(world, name, found[0][1], found[0][0], best[1], best[0])


def _calibrated(data: Dataset, ontology: Ontology, som: Som, rows: int) -> Calibrations:
    """Return what the reconfigurator knows once the monitor has heard so many rows of a drive."""
    found, robot = Calibrations(), Robot(som, ontology)
    for now, service, values in messages(replace(data, time=data.time[:rows]), som):
        robot.say(START_S + now, service, service.node, values)
    for row in robot.rows:
        found.add(row, healing=False)
    return found


def _lost(som: Som, name: str) -> Tuple[str, ...]:
    """Return the service of a property that healing would replace, and its node."""
    having = [service for service in som if name in service.properties]
    having.sort(key=lambda service: not service.needed)
    return (having[0].name, having[0].node) if having else ()


def _rms(errors: np.ndarray) -> Optional[float]:
    there = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(there**2))) if len(there) >= THERE * len(errors) else None


def _words(derivation: Derivation) -> str:
    inputs = ", ".join(source.path for source in derivation.sources())
    return f"{' < '.join(derivation.relations()) or 'passed on'} of {inputs}"

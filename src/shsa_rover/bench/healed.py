"""A drive whose amperemeter is lost at some time, and what each way to go on makes of it."""
from dataclasses import dataclass
from random import Random
from typing import Dict, Iterator, List, Mapping, Optional, Tuple

import numpy as np

from derived import Columns
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.codegen.prediction import predictor
from shsa_core.derivations.calibrator import Calibrator
from shsa_core.model.calibration import Calibration
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.search.derivation import SourceTable
from shsa_rover.battery import BatteryParameters
from shsa_rover.dataset import CURRENT, PERIOD_S, Dataset, random_drive, simulate
from shsa_rover.worlds import World

LOST = "battery_current"
LEGS_A_MINUTE = 24  # more than are driven
FIRST, LAST = 0.1, 0.9  # of the drive: the sensor is lost in between
CHARGES = (0.3, 0.95)  # states of charge at the start
SAMPLE_ROWS = 10  # rows between two that the calibration is given: 5 Hz
LONGEST_LAG_ROWS = 25
SENSOR, MEAN = "sensor", "mean of the sensor before"
UNHEALED = "without healing"
HELD_ROWS = 100  # for which the estimator holds the last current; then it counts nothing
CHOSEN, SECOND = "chosen", "second choice"
CALIBRATED = ", calibrated"
WAYS = (SENSOR, UNHEALED, MEAN, CHOSEN, CHOSEN + CALIBRATED, SECOND, SECOND + CALIBRATED)
"""Ways in which the current goes on; the first, to compare with, loses nothing."""


@dataclass(frozen=True)
class Outcome:
    """One way in one drive; the figures are of the time after the loss, but `charge_error`.

    `charge_error`: of the state of charge at the end, percentage points; `rms` and `span` of the
    current in A; `lag` in s; `covered`: the share of moments at which the error was within the p95
    that was stated, None: none was.
    """

    world: str
    seed: int
    lost_at: float
    way: str
    charge_error: float
    rms: float
    span: float
    lag: float
    covered: Optional[float]

    @property
    def nrmse(self) -> float:
        """% of the span of the true current in the drive."""
        return 100.0 * self.rms / self.span


def drive(
    world: World, seed: int, seconds: float, then: Optional[Tuple[float, World]] = None
) -> Dataset:
    """Return a drive that nothing was fitted to; `then`: so many s later in another world."""
    random = Random(f"{seed}/unseen")
    legs = round(LEGS_A_MINUTE * seconds / 60.0) + 1
    return simulate(random_drive(seed, legs), seconds, seed, random.uniform(*CHARGES), world, then)


def plans(ontology: Ontology, som: Som) -> Tuple[Plan, Plan]:
    """Return healing's plan for a lost amperemeter, and the best by other relations."""
    service = next(each for each in som if LOST in each.properties)
    question = ontology, service, SourceTable(ontology.network, som.sources)
    errors = predictor(ontology, som.sources)
    tried = [plan_service(*question, predictor=errors)]
    while tried[-1].relations == tried[0].relations:
        tried.append(plan_service(*question, tried=tried, predictor=errors))
    return tried[0], tried[-1]


def outcomes(
    world: str, seed: int, data: Dataset, ontology: Ontology, choices: Tuple[Plan, Plan]
) -> Iterator[Outcome]:
    """Yield each way, in the order of WAYS."""
    lost_at = Random(f"{seed}/lost").uniform(FIRST, LAST) * float(data.time[-1])
    row = int(lost_at / PERIOD_S)
    for way, values, p95 in _ways(row, data, ontology, choices):
        yield _outcome(world, seed, lost_at, way, row, values, p95, data)


def _ways(
    row: int, data: Dataset, ontology: Ontology, choices: Tuple[Plan, Plan]
) -> Iterator[Tuple[str, np.ndarray, Optional[float]]]:
    """Yield every way: what it yields from row on, and the p95 error that it states."""
    measured = data.measured[CURRENT]
    yield SENSOR, measured, None
    held = np.where(np.arange(len(measured)) < row + HELD_ROWS, measured[row - 1], 0.0)
    yield UNHEALED, held, None
    yield MEAN, np.full_like(measured, np.mean(measured[:row])), None
    columns = Columns(ontology, data.time, data.measured)
    for name, plan in zip((CHOSEN, SECOND), choices):
        (derivation,) = plan.derivations
        derived = columns.of(derivation)
        stated = plan.errors[0]
        yield name, derived, stated.p95 if stated else None
        calibration = calibrate(data.time, measured, derived, row, stated.rms if stated else None)
        error = calibration.error
        yield name + CALIBRATED, calibration.gain * derived + calibration.offset, (
            error.p95 if error else None
        )


def calibrate(
    time: np.ndarray, measured: np.ndarray, derived: np.ndarray, row: int, stated: Optional[float]
) -> Calibration:
    """Return what is known of a derivation by the row at which the sensor is lost."""
    calibrator = Calibrator(stated)
    rows = slice(0, row, SAMPLE_ROWS)
    samples = zip(time[rows].tolist(), measured[rows].tolist(), derived[rows].tolist())
    for now, sensor, relation in samples:
        calibrator.take(now, sensor, relation)
    return calibrator.snapshot()


def _outcome(
    world: str,
    seed: int,
    lost_at: float,
    way: str,
    row: int,
    values: np.ndarray,
    p95: Optional[float],
    data: Dataset,
) -> Outcome:
    truth = data.truth[LOST]
    counted = np.concatenate([data.measured[CURRENT][:row], values[row:]])
    capacity = BatteryParameters().capacity
    charge = 100.0 * abs(float(np.nansum(counted - truth))) * PERIOD_S / 3600.0 / capacity
    errors = values[row:] - truth[row:]
    errors = errors[np.isfinite(errors)]
    return Outcome(
        world,
        seed,
        lost_at,
        way,
        charge,
        float(np.sqrt(np.mean(errors**2))),
        float(np.ptp(truth)),
        lag(values[row:], truth[row:]),
        None if p95 is None else float(np.mean(np.abs(errors) <= p95)),
    )


def lag(values: np.ndarray, truth: np.ndarray) -> float:
    """By how many s values are most like the truth before them; between rows by a parabola."""
    most = LONGEST_LAG_ROWS
    inner = truth[most:-most]
    if not np.nanmax(values) > np.nanmin(values):
        return 0.0
    errors = [
        float(np.nanvar(values[most + shift : len(values) - most + shift] - inner))
        for shift in range(-most, most + 1)
    ]
    best = int(np.argmin(errors))
    shift = float(best - most)
    if 0 < best < 2 * most:
        before, at, after = errors[best - 1 : best + 2]
        shift += 0.5 * (before - after) / (before - 2.0 * at + after)
    return shift * PERIOD_S


def by_way(found: List[Outcome]) -> Mapping[Tuple[str, str], List[Outcome]]:
    """Return the outcomes of each world and way."""
    table: Dict[Tuple[str, str], List[Outcome]] = {}
    for each in found:
        table.setdefault((each.world, each.way), []).append(each)
    return table

"""The error that the monitor states of a substitute, second by second after the loss."""
from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from derived import Columns
from healed import LOST
from shsa_core.codegen.plans import Plan
from shsa_core.model.calibration import UNCALIBRATED, CalibrationRow
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Deadlines, Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring import events
from shsa_core.monitoring.machine import Monitor
from shsa_rover.battery import BatteryParameters
from shsa_rover.dataset import CURRENT, PERIOD_S, STATE_OF_CHARGE, Dataset
from witnesses import messages, slower

START_S, SECONDS = 1000.0, 60.0
SUBSTITUTE = "/substitute_1"


@dataclass(frozen=True)
class Stated:
    """The shares of moments at which the error was within the p95 that was stated then.

    `covered`: until the end; `changed`: in the first SECONDS after the world changed, not a number
    if it did not; `wide`: the p95 stated, as a multiple of the calibration's, on average.
    """

    world: str
    seed: int
    covered: float
    changed: float
    wide: float


class Robot:
    """The monitor, and what it tells of calibrations: in all `rows`, and of a plan."""

    def __init__(self, som: Som, ontology: Ontology, plan: Optional[Plan] = None) -> None:
        self._core, self._program = Monitor(ontology=ontology), plan and plan.program
        self.rows: List[CalibrationRow] = []
        self.calibration = UNCALIBRATED
        self.hear(events.SomChanged(START_S, som))
        for service in som:
            self.hear(events.Connected(START_S, service.topic, service.node))

    def hear(self, event: events.Event) -> None:
        """Let the monitor handle an event."""
        for said in self._core.handle(event):
            for row in said.rows if isinstance(said, events.CalibrationsChanged) else ():
                self.rows.append(row)
                if row.program == self._program:
                    (self.calibration,) = row.calibrations

    def say(self, time: float, service: Service, node: str, values: Sequence[float]) -> None:
        """Let a node say the values of a service."""
        self.hear(events.Message(time, service.topic, node, tuple(values)))
        self.hear(events.Tick(time))

    def lose(self, time: float, service: Service) -> None:
        """Lose the node of a service: a substitute takes its place."""
        self.hear(events.Disconnected(time, service.topic, service.node))
        signals = tuple(Som().signal(each, Deadlines(), True) for each in service.sources)
        row = Substitution(SUBSTITUTE, service.name, (), "y=0.0", signals, publishing=True)
        self.hear(events.SubstitutionsChanged(time, (row,), whole=True))
        self.hear(events.Connected(time, service.topic, SUBSTITUTE))


def stated(
    world: str,
    seed: int,
    data: Dataset,
    models: Tuple[Ontology, Som],
    plan: Plan,
    lost_at: float,
    changed_at: float = np.nan,
) -> Stated:
    """Lose the amperemeter in a drive, and let the monitor watch what takes its place."""
    robot, service, som = _until(data, models, plan, lost_at)
    derived = Columns(models[0], data.time, data.measured).of(plan.derivations[0])
    row, frozen = round(lost_at / PERIOD_S), robot.calibration
    robot.lose(START_S + lost_at, service)
    published = frozen.gain * derived + frozen.offset
    after = _counted_on(data, published, row)
    found: List[Tuple[float, float, float]] = []
    for now, each, values in messages(after, som):
        if now < lost_at:
            continue
        if each.name != service.name:
            robot.say(START_S + now, each, each.node, values)
        elif np.isfinite(values[0]):
            robot.say(START_S + now, each, SUBSTITUTE, values)
            off = abs(values[0] - float(data.truth[LOST][round(now / PERIOD_S)]))
            error = robot.calibration.error
            found.append((now, off, np.nan if error is None else error.p95 or np.nan))
    time, off, p95 = np.array(found).T
    within = off <= p95
    late = (time >= changed_at) & (time < changed_at + SECONDS)
    usual = frozen.error.p95 if frozen.error is not None else None
    return Stated(
        world,
        seed,
        float(np.mean(within[time >= changed_at] if late.any() else within)),
        float(np.mean(within[late])) if late.any() else np.nan,
        float(np.nanmean(p95)) / (usual or np.nan),
    )


def drifted(
    data: Dataset, models: Tuple[Ontology, Som], plan: Plan, lost_at: float, drift: np.ndarray
) -> Tuple[float, float]:
    """Return the rms errors after the loss, uncalibrated and calibrated by a sensor that drifts.

    `drift` is what is added to what it measures, in A.
    """
    spoilt = {**data.measured, CURRENT: data.measured[CURRENT] + drift}
    calibration = _until(replace(data, measured=spoilt), models, plan, lost_at)[0].calibration
    derived = Columns(models[0], data.time, data.measured).of(plan.derivations[0])
    row = round(lost_at / PERIOD_S)
    truth, plain = data.truth[LOST][row:], derived[row:]
    published = calibration.gain * plain + calibration.offset
    return _rms(plain - truth), _rms(published - truth)


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))


def _until(
    data: Dataset, models: Tuple[Ontology, Som], plan: Plan, lost_at: float
) -> Tuple[Robot, Service, Som]:
    """Let the monitor hear a drive until the loss; return it, what is lost, and the SOM."""
    ontology, som = models
    service = next(each for each in slower(som) if LOST in each.properties)
    # What is compared with others comes after them: at 50 Hz it is 0.02 s behind, not 0.1 s.
    som = Som([*(each for each in slower(som) if each.name != service.name), service])
    robot = Robot(som, ontology, plan)
    before = replace(data, time=data.time[: round(lost_at / PERIOD_S)])
    for now, each, values in messages(before, som):
        robot.say(START_S + now, each, each.node, values)
    return robot, service, som


def _counted_on(data: Dataset, published: np.ndarray, row: int) -> Dataset:
    """Return the drive as it is with a substitute: it is what the estimator counts on with."""
    charge = data.measured[STATE_OF_CHARGE].copy()
    used = np.cumsum(np.nan_to_num(published[row:])) * PERIOD_S / 3600.0
    charge[row:] = charge[row - 1] - used / BatteryParameters().capacity
    current = np.concatenate([data.measured[CURRENT][:row], published[row:]])
    changed: Dict[str, np.ndarray] = {STATE_OF_CHARGE: charge, CURRENT: current}
    return replace(data, measured={**data.measured, **changed})

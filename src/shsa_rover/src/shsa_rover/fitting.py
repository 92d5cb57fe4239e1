"""Fits the relations of `rover.yaml` that are learned from recorded drives (least squares)."""
import math
from dataclasses import dataclass
from typing import List, Mapping, Sequence

import numpy as np

from shsa_rover.chassis import GRAVITY, ChassisParameters
from shsa_rover.dataset import (
    ACCELERATION,
    COMMANDED_TURN_RATE,
    COMMANDED_VELOCITY,
    CURRENT,
    GYROSCOPE,
    PERIOD_S,
    STATE_OF_CHARGE,
    TURN_ACCELERATION,
    TURN_RATE,
    VELOCITY,
    VOLTAGE,
    Dataset,
)

F1_INPUTS = {
    "velocity": VELOCITY,
    "acceleration": ACCELERATION,
    "turn_rate": TURN_RATE,
    "turn_acceleration": TURN_ACCELERATION,
    "voltage": VOLTAGE,
}
"""The inputs of f1 in the paper's order (Section V-A3): v, a, omega, alpha, u."""

PUBLISHED = {
    "constant": 48.67,
    "velocity": -0.03,
    "acceleration": -1.17,
    "turn_rate": 2.07,
    "turn_acceleration": -0.03,
    "voltage": -3.72,
}
"""The paper's f1, learned on the authors' rover: A, and A by the unit of each input."""

OCV_EMPTY, OCV_FULL = 11.75, 12.88  # V, a straight line through the battery's table
POLARISATION_TIME_S = 20.0
TIMES = np.arange(0.05, 1.0, 0.05)  # s, tried as time constants


@dataclass(frozen=True)
class Fit:
    """A relation's coefficients, and its root mean square error and span in its unit."""

    relation: str
    unit: str
    coefficients: Mapping[str, float]
    error: float
    span: float


def f1_terms(drives: Sequence[Dataset]) -> np.ndarray:
    """The columns that f1 sums: 1, |v|, |a|, |omega|, |alpha|, u."""
    # The battery's voltage is positive: its magnitude is itself.
    columns = [np.abs(_joined(drives, path)) for path in F1_INPUTS.values()]
    return np.array([np.ones_like(columns[0]), *columns]).T


def fit_f1(drives: Sequence[Dataset]) -> Fit:
    """f1: the battery's current (A) from velocities, accelerations and the voltage.

    It is fitted to all the drives together. From one alone, hence at one state of charge, it would
    take the battery's voltage for the sag alone, and be wrong by amperes as soon as the battery has
    drained.
    """
    terms, current = f1_terms(drives), _joined(drives, CURRENT)
    return f1_with("f1", dict(zip(PUBLISHED, _solve(terms, current))), drives)


def f1_with(name: str, coefficients: Mapping[str, float], drives: Sequence[Dataset]) -> Fit:
    """How well f1 with these coefficients, in the order of PUBLISHED, tells the current (A)."""
    predicted = f1_terms(drives) @ np.array([coefficients[each] for each in PUBLISHED])
    return _fit(name, "A", coefficients, predicted, _joined(drives, CURRENT))


def fit_without_voltage(drives: Sequence[Dataset]) -> Fit:
    """f1 without its last input, for comparison."""
    terms, current = f1_terms(drives)[:, :-1], _joined(drives, CURRENT)
    coefficients = dict(zip(PUBLISHED, [*_solve(terms, current), 0.0]))
    return f1_with("f1 without voltage", coefficients, drives)


def drive_power(data: Dataset) -> np.ndarray:
    """The relations `wheels` and `traction`: W on the ground, with the constants of the chassis."""
    p = ChassisParameters()
    velocity, turn_rate = data.measured[VELOCITY], data.measured[TURN_RATE]
    left, right = velocity - 0.5 * p.track * turn_rate, velocity + 0.5 * p.track * turn_rate
    rolling = p.rolling_friction * p.mass * GRAVITY
    scrub = 0.5 * p.scrub_friction * p.mass * GRAVITY * p.wheel_spacing
    return (
        rolling * 0.5 * (np.abs(left) + np.abs(right))
        + p.viscous_friction * 0.5 * (left**2 + right**2)
        + (p.mass + p.rotating_mass) * velocity * data.measured[ACCELERATION]
        + scrub * np.abs(turn_rate)
    )


def fit_motors(data: Dataset) -> Fit:
    """motors: the battery's power (W) from wheels, skidding and electronics."""
    power = data.measured[VOLTAGE] * data.measured[CURRENT]
    skid = np.abs(data.measured[TURN_RATE])
    terms = np.array([np.ones_like(power), np.maximum(0.0, drive_power(data)), skid]).T
    solution = _solve(terms, power)
    coefficients = {
        "electronics_power": solution[0],
        "drive_efficiency": 1.0 / solution[1],
        "skid_loss": solution[2],
    }
    return _fit("motors", "W", coefficients, terms @ solution, power)


def fit_sag(data: Dataset) -> Fit:
    """sag: the battery's voltage (V) below its open-circuit voltage, at once and after a while."""
    current, voltage = data.measured[CURRENT], data.measured[VOLTAGE]
    source = OCV_EMPTY + (OCV_FULL - OCV_EMPTY) * data.measured[STATE_OF_CHARGE]
    terms = np.array([current, lowpass(current, POLARISATION_TIME_S)]).T
    solution = _solve(terms, source - voltage)
    names = ("internal_resistance", "polarisation_resistance")
    return _fit("sag", "V", dict(zip(names, solution)), source - terms @ solution, voltage)


def fit_lag(data: Dataset, relation: str, unit: str, command: str, response: str) -> Fit:
    """The time constant (s) by which the rover follows its commands."""
    return _best_time(relation, unit, data.measured[command], data.measured[response])


def f1_variants(drives: Sequence[Dataset]) -> List[Fit]:
    """f1 and what it is compared with: no voltage, the first drive alone, as published."""
    alone = fit_f1(drives[:1]).coefficients
    return [
        fit_f1(drives),
        fit_without_voltage(drives),
        f1_with("f1 from the first drive alone", alone, drives),
        f1_with("f1 as published", PUBLISHED, drives),
    ]


def fit_others(data: Dataset) -> List[Fit]:
    """Every other fitted relation of the rover."""
    return [
        fit_motors(data),
        fit_sag(data),
        fit_lag(data, "steering", "m/s", COMMANDED_VELOCITY, VELOCITY),
        fit_lag(data, "steering", "rad/s", COMMANDED_TURN_RATE, GYROSCOPE),
    ]


def lowpass(values: np.ndarray, time: float) -> np.ndarray:
    """A filter of first order with the time constant `time` (s), starting at the first value."""
    share = -math.expm1(-PERIOD_S / time)
    filtered = np.empty_like(values)
    state = values[0]
    for row, value in enumerate(values):
        state += share * (value - state)
        filtered[row] = state
    return filtered


def _joined(drives: Sequence[Dataset], path: str) -> np.ndarray:
    return np.concatenate([data.measured[path] for data in drives])


def _best_time(relation: str, unit: str, source: np.ndarray, target: np.ndarray) -> Fit:
    fits = [
        _fit(relation, unit, {"time": float(time)}, lowpass(source, float(time)), target)
        for time in TIMES
    ]
    return min(fits, key=lambda fit: fit.error)


def _solve(terms: np.ndarray, target: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(terms, target, rcond=None)[0]


def _fit(
    relation: str,
    unit: str,
    coefficients: Mapping[str, float],
    predicted: np.ndarray,
    target: np.ndarray,
) -> Fit:
    error = float(np.sqrt(np.mean((predicted - target) ** 2)))
    return Fit(relation, unit, dict(coefficients), error, float(np.ptp(target)))

"""Fits the relations of `rover.yaml` that are learned from a recorded drive (least squares)."""
import math
from dataclasses import dataclass
from typing import List, Mapping

import numpy as np

from shsa_rover.chassis import GRAVITY, ChassisParameters
from shsa_rover.dataset import (
    ACCELERATION,
    COMMANDED_TURN_RATE,
    COMMANDED_VELOCITY,
    CURRENT,
    GYROSCOPE,
    PERIOD,
    STATE_OF_CHARGE,
    TURN_ACCELERATION,
    TURN_RATE,
    VELOCITY,
    VOLTAGE,
    Dataset,
)

PUBLISHED = {"constant": 48.67, "velocity": -0.03, "acceleration": -1.17}
"""Those coefficients of the paper's f1 that are known here; its further terms are not."""

OCV_EMPTY, OCV_FULL = 11.75, 12.88  # V, a straight line through the battery's table
POLARISATION_TIME = 20.0  # s
TIMES = np.arange(0.05, 1.0, 0.05)  # s, tried as time constants


@dataclass(frozen=True)
class Fit:
    """A relation's coefficients, its root mean square error and the span of what it predicts, in its unit."""

    relation: str
    unit: str
    coefficients: Mapping[str, float]
    error: float
    span: float


def f1_terms(data: Dataset) -> np.ndarray:
    """The columns that f1 sums: 1, |v|, |a|, |omega|, |alpha|."""
    names = (VELOCITY, ACCELERATION, TURN_RATE, TURN_ACCELERATION)
    columns = [np.ones_like(data.time)] + [np.abs(data.measured[name]) for name in names]
    return np.array(columns).T


def fit_f1(data: Dataset) -> Fit:
    """f1: the battery's current (A) as a sum of the magnitudes of velocities and accelerations."""
    terms, current = f1_terms(data), data.measured[CURRENT]
    solution = _solve(terms, current)
    names = ("constant", "velocity", "acceleration", "turn_rate", "turn_acceleration")
    return _fit("f1", "A", dict(zip(names, solution)), terms @ solution, current)


def published_f1(data: Dataset) -> Fit:
    """The known part of the paper's f1 on this rover; nothing is fitted."""
    terms = f1_terms(data)[:, : len(PUBLISHED)]
    predicted = terms @ np.array(list(PUBLISHED.values()))
    return _fit("f1 as published", "A", PUBLISHED, predicted, data.measured[CURRENT])


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
    """motors: the battery's power (W) from the wheels' power, what skidding costs on top, and the electronics."""
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
    terms = np.array([current, lowpass(current, POLARISATION_TIME)]).T
    solution = _solve(terms, source - voltage)
    names = ("internal_resistance", "polarisation_resistance")
    return _fit("sag", "V", dict(zip(names, solution)), source - terms @ solution, voltage)


def fit_lag(data: Dataset, relation: str, unit: str, command: str, response: str) -> Fit:
    """The time constant (s) by which the rover follows its commands."""
    return _best_time(relation, unit, data.measured[command], data.measured[response])


def fit_all(data: Dataset) -> List[Fit]:
    """Every fitted relation of the rover, and the published f1 for comparison."""
    return [
        fit_f1(data),
        published_f1(data),
        fit_motors(data),
        fit_sag(data),
        fit_lag(data, "steering", "m/s", COMMANDED_VELOCITY, VELOCITY),
        fit_lag(data, "steering", "rad/s", COMMANDED_TURN_RATE, GYROSCOPE),
    ]


def lowpass(values: np.ndarray, time: float) -> np.ndarray:
    """A filter of first order with the time constant `time` (s), starting at the first value."""
    share = -math.expm1(-PERIOD / time)
    filtered = np.empty_like(values)
    state = values[0]
    for row, value in enumerate(values):
        state += share * (value - state)
        filtered[row] = state
    return filtered


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

"""An honest reference for what can be learned of a recording: scikit-learn, by blocks of time.

Nothing of shsa_learning is used. Each of six blocks is predicted by the best of some models, chosen
by blocks of the other five alone; what is within 2 s of the block is in neither part.
"""
from typing import Any, Dict, List, Tuple

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.linear_model import LassoLarsCV, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

Fold = Tuple[np.ndarray, np.ndarray]
OUTER, INNER, PURGE_S, MOST_ROWS = 6, 4, 2.0, 3000


def models() -> Dict[str, Any]:
    """Return what competes: linear, sparse and quadratic regression, and boosted trees."""
    return {
        "ridge": make_pipeline(StandardScaler(), Ridge(alpha=1.0)),
        "lasso": make_pipeline(StandardScaler(), LassoLarsCV(cv=INNER)),
        "quadratic": make_pipeline(
            StandardScaler(), PolynomialFeatures(2), StandardScaler(), Ridge(alpha=10.0)
        ),
        "boosting": HistGradientBoostingRegressor(
            max_leaf_nodes=15, learning_rate=0.08, min_samples_leaf=30, random_state=0
        ),
    }


def folds(time: np.ndarray, count: int) -> List[Fold]:
    """Return rows that are learned from, and rows of a block that are told, block by block."""
    found = []
    for test in np.array_split(np.arange(len(time)), count):
        begin, end = time[test[0]], time[test[-1]]
        purge = min(PURGE_S, 0.25 * (end - begin))
        found.append((np.flatnonzero((time < begin - purge) | (time > end + purge)), test))
    return found


def reference(time: np.ndarray, target: np.ndarray, inputs: np.ndarray) -> Tuple[float, float, str]:
    """Return the RMS error of the best models by nested blocks, that of the mean, and their names.

    `inputs`: a column each. Rows with a missing value are left out, and evenly thinned.
    """
    known = np.flatnonzero(np.isfinite(target) & np.isfinite(inputs).all(axis=1))
    known = known[:: max(1, -(-len(known) // MOST_ROWS))]
    time, target, inputs = time[known], target[known], inputs[known]
    off, mean_off, names = np.zeros(len(target)), np.zeros(len(target)), []
    for train, test in folds(time, OUTER):
        errors = {
            name: float(
                np.mean(
                    [
                        rms(_off(model, inputs[train], target[train], inner))
                        for inner in folds(time[train], INNER)
                    ]
                )
            )
            for name, model in models().items()
        }
        best = min(errors, key=lambda name: errors[name])
        names.append(best)
        off[test] = _off(models()[best], inputs, target, (train, test))
        mean_off[test] = np.mean(target[train]) - target[test]
    return rms(off), rms(mean_off), max(names, key=names.count)


def _off(model: Any, inputs: np.ndarray, target: np.ndarray, fold: Fold) -> np.ndarray:
    train, test = fold
    said: np.ndarray = model.fit(inputs[train], target[train]).predict(inputs[test])
    return said - target[test]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))

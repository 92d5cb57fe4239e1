"""The figures of an error, by its values: predicted or published less what was true."""
import numpy as np

from shsa_core.model.error import Error


def rms(off: np.ndarray) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(off)))) if len(off) else float("nan")


def error_of(off: np.ndarray, baseline: float, delay: float = 0.0, source: str = "") -> Error:
    """Return the error that finite values show; `baseline`: the rms of who always says the mean."""
    return Error(
        rms(off),
        float(np.mean(off)),
        float(np.quantile(np.abs(off), 0.95)),
        delay,
        baseline,
        len(off),
        source,
    )

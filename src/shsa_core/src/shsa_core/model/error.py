"""The error of a value: its distance from the truth, in the unit of its property."""
from dataclasses import dataclass
from typing import Optional


P95 = 1.959964
"""Standard deviations within which 95 % of a normal distribution lie."""
SPREAD_RMS, SPREAD_P95 = 4.0, 2.0
"""A value may be so many rms, and so many times its p95, from the truth."""


@dataclass(frozen=True)
class Error:
    """The error of what a service or a relation yields, against what was true on recorded data.

    `rms`: root mean square, all in; `bias`: the mean of value minus truth; `p95`: of its magnitude;
    `delay` in s by which it lags; `baseline`: the rms of who always says the mean of the truth;
    `n`: points that it was measured on; `source`: where, in words. None: not known.
    """

    rms: float
    bias: float = 0.0
    p95: Optional[float] = None
    delay: float = 0.0
    baseline: Optional[float] = None
    n: Optional[int] = None
    source: str = ""

    @property
    def within(self) -> float:
        """Return what 95 % of it are within: p95; not known: as if it were normal."""
        return P95 * self.rms if self.p95 is None else self.p95

    @property
    def quality(self) -> Optional[float]:
        """1 - rms/baseline, in (0, 1]; None where the baseline is not known."""
        if not self.baseline:
            return None
        return min(1.0, max(1e-4, 1.0 - self.rms / self.baseline))


def quality_of(error: Optional[Error]) -> float:
    """Return the quality of what says none itself: by the figures of its error, else 1."""
    return 1.0 if error is None else error.quality or 1.0


def refusal(error: Optional[Error], limit: Optional[float]) -> str:
    """Return why a value of this error is not used, by the `limit` of its p95; empty: it may be."""
    if error is None:
        return ""
    if limit is not None and error.within > limit:
        return f"its error of {error.within:.3g} (p95) is above fault_tolerant_error, {limit:g}"
    if error.baseline is not None and error.rms >= error.baseline:
        mean = f"{error.baseline:.3g}"
        return f"its error of {error.rms:.3g} (rms) is not below that of the mean, {mean}"
    return ""


def spread(error: Optional[Error]) -> Optional[float]:
    """Return how far a value with this error may be from the truth, in its unit.

    Errors last for as long as a look back and do not average out; p95 is of single moments.
    """
    if error is None:
        return None
    return max(SPREAD_RMS * error.rms, SPREAD_P95 * (error.p95 or 0.0))

"""The error of a value in a file or on the parameter server: a number, or a mapping of figures."""
from typing import Any, Dict, Optional

from shsa_core.files.document import Value
from shsa_core.model.error import Error

KEYS = {
    "rms": "root mean square of value minus truth; required",
    "bias": "mean of value minus truth; at most rms in size; default: 0",
    "p95": "what the size of the error is within in 95 % of the points",
    "delay": "s by which the value lags; default: 0",
    "baseline": "the RMS error of who always says the mean of the truth",
    "n": "points that it was measured on",
    "source": "where it was measured, in words",
}
"""What a mapping of figures may say; all but `delay` and `n` in the property's unit."""


def read_error(value: Value, key: str) -> Error:
    """The error that a value says: its rms alone, or a mapping of KEYS.

    Raises ModelError with file and line.
    """
    if not isinstance(value.data, dict):
        return Error(_positive(value, key))
    entry = value.entry(key, KEYS, required=("rms",))
    rms = _positive(entry["rms"], f"{key}: rms")
    bias = entry["bias"].number(f"{key}: bias") if "bias" in entry else 0.0
    if abs(bias) > rms:
        raise entry["bias"].error(f"{key}: bias must be at most rms, {rms:g}, not {bias:g}")
    delay = entry["delay"].number(f"{key}: delay") if "delay" in entry else 0.0
    p95 = entry["p95"].number(f"{key}: p95") if "p95" in entry else None
    for name, number in (("delay", delay), ("p95", p95)):
        if number is not None and number < 0.0:
            raise entry[name].error(f"{key}: {name} must be 0 or above, not {number:g}")
    baseline = _positive(entry["baseline"], f"{key}: baseline") if "baseline" in entry else None
    source = entry["source"].string(f"{key}: source") if "source" in entry else ""
    return Error(rms, bias, p95, delay, baseline, _count(entry.get("n"), f"{key}: n"), source)


def plain_error(error: Error) -> Any:
    """An error as it is written: its rms alone, or a mapping of what is known."""
    figures: Dict[str, Any] = {"rms": error.rms}
    for key in list(KEYS)[1:]:
        figure = getattr(error, key)
        if figure != getattr(Error, key):
            figures[key] = figure
    return error.rms if len(figures) == 1 else figures


def usual_quality(error: Optional[Error]) -> float:
    """The quality of what says none: by its figures, else 1."""
    quality = None if error is None else error.quality
    return 1.0 if quality is None else quality


def _positive(value: Value, what: str) -> float:
    number = value.number(what)
    if number <= 0.0:
        raise value.error(f"{what} must be above 0, not {number:g}")
    return number


def _count(value: Optional[Value], what: str) -> Optional[int]:
    if value is None:
        return None
    number = value.number(what)
    if number != int(number) or number < 1.0:
        raise value.error(f"{what} must be a whole number above 0, not {number:g}")
    return int(number)

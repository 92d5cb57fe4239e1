"""Durations as people write them: `5s`, `200ms`, `1.5min`."""
import math
import re

UNITS_S = {"ms": 0.001, "s": 1.0, "": 1.0, "min": 60.0, "h": 3600.0}
_TEXT = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)(ms|s|min|h|)")


def seconds(text: str) -> float:
    """Return a duration in s; a bare number is in s. Raises ValueError if it is not above 0."""
    match = _TEXT.fullmatch(text.strip())
    value = float(match.group(1)) * UNITS_S[match.group(2)] if match else math.nan
    if not 0.0 < value < math.inf:
        raise ValueError(f"{text!r} is no duration above 0, as 5s, 200ms or 1.5min")
    return value

"""Values from outside as a JSON document may have them: finite, printable, not endless."""
import math
from typing import Iterable, List, Optional

from shsa_core.text import shown

MOST = 200
"""Items of a list that are shown."""
LONGEST_CODE = 20_000


def number(value: Optional[float]) -> Optional[float]:
    """Return the number if it is finite; else None."""
    return None if value is None or not math.isfinite(value) else float(value)


def texts(values: Iterable[str]) -> List[str]:
    """Texts, each on one line."""
    return [shown(each) for each in list(values)[:MOST]]


def code(text: str) -> str:
    """Return a text of several lines."""
    return "\n".join(shown(line, LONGEST_CODE) for line in text[:LONGEST_CODE].split("\n"))

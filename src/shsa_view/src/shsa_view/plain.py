"""Values from outside as a JSON document may have them: of the right kind, finite, not endless."""
import math
from typing import Any, List, Mapping, Optional, Sequence

from shsa_core.text import shown

MOST = 200
"""Items of a list that are shown."""
LONGEST_CODE = 20_000


def number(value: object) -> Optional[float]:
    """A finite number; None if it is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if math.isfinite(value) else None


def text_at(record: Mapping[str, Any], key: str) -> str:
    """The text of a key, on one line; empty if there is none."""
    value = record.get(key)
    return shown(value) if isinstance(value, str) else ""


def code_at(record: Mapping[str, Any], key: str) -> str:
    """The text of a key that may have several lines."""
    value = record.get(key)
    return code(value) if isinstance(value, str) else ""


def code(text: str) -> str:
    """A text of several lines."""
    return "\n".join(shown(line, LONGEST_CODE) for line in text[:LONGEST_CODE].split("\n"))


def texts_at(record: Mapping[str, Any], key: str) -> List[str]:
    """The texts in the list of a key."""
    return [shown(each) for each in items_at(record, key) if isinstance(each, str)]


def items_at(record: Mapping[str, Any], key: str) -> Sequence[Any]:
    """The list of a key, as far as it is shown; empty if it is none."""
    value = record.get(key)
    return value[:MOST] if isinstance(value, (list, tuple)) else ()

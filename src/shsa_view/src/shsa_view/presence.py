"""The presence of a healer: by its connection, and by when it was last heard."""
from typing import Optional, Tuple

SILENT_S = 4.0
"""Healers tell of themselves once a second; with a busy computer one or two of these are late."""


def presence(connected: bool, ever: bool, silent: Optional[float]) -> Tuple[str, str]:
    """Return the state of a healer, `alive`, `lost` or `unknown`, and what is wrong in words.

    `connected`: it sends us a table; `ever`: it did at some time; `silent`: s since it was heard.
    """
    if not connected:
        return ("lost", "it is gone") if ever else ("unknown", "it was not heard yet")
    if silent is not None and silent > SILENT_S:
        return "lost", f"it has said nothing for {silent:.0f} s"
    return "alive", ""

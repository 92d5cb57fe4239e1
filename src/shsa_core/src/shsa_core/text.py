"""Text from outside as it may be shown or logged: printable, on one line, not endless."""
import difflib
from typing import Iterable

LONGEST = 1000  # characters of a text that are shown, where nothing else is said
LONGEST_LINE = 10_000  # the same for a line that is ours, and quotes such texts


def shown(text: object, most: int = LONGEST) -> str:
    r"""Return the text of something on one line, what is not printable as `\x1b`, and not endless.

    Shown again, it stays as it is, so that it does no harm to be careful twice.
    """
    whole = str(text)
    first = whole[:most]
    if not first.isprintable():
        first = "".join(each if each.isprintable() else ascii(each)[1:-1] for each in first)
    return first + "..." if len(whole) > most else first


def short(text: str) -> str:
    """Return the text, or its beginning, as it is quoted in a line."""
    return text if len(text) <= 60 else text[:57] + "..."


def nearest(name: str, known: Iterable[str], most: int = 1) -> str:
    """Return "; did you mean ...?" with the names that may have been meant; empty: none is near."""
    near = difflib.get_close_matches(name, sorted(known), n=most)
    return f"; did you mean {' or '.join(near)}?" if near else ""

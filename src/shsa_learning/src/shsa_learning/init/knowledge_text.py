"""Functions as the predecessor's knowledge bases write them, in the words of the language."""
import re
from typing import Collection, Dict, Tuple

REDUCTIONS = {"min": "min", "max": "max", "mean": "mean", "average": "mean"}
"""Functions that make one number of an array, and their form in a field of the SOM."""

_SPELLINGS = (
    (re.compile(r"\b(math|np|numpy)\."), ""),
    (re.compile(r"\barctan2\b"), "atan2"),
    (re.compile(r"\barc(sin|cos|tan)\b"), r"a\1"),
    (re.compile(r"\bfabs\b"), "abs"),
    (re.compile(r"\^"), "**"),
    (re.compile(r"\bintegral\s*\(\s*([^()]+?)\s+dt\s*\)"), r"integral(\1)"),
    (re.compile(r"\bd\s+([A-Za-z_]\w*)\s*/\s*dt\b"), r"derivative(\1)"),
    (re.compile(r"\bint\s*\(([^()]*[<>=][^()]*)\)"), r"(1 if \1 else 0)"),
)
_REDUCTION = re.compile(rf"\b({'|'.join(REDUCTIONS)})\s*\(\s*([A-Za-z_]\w*)\s*\)")


def translated(text: str) -> str:
    """Return the text with mathematical spellings as the language has them."""
    for pattern, words in _SPELLINGS:
        text = pattern.sub(words, text)
    return text


def reduced(text: str, arrays: Collection[str]) -> Tuple[str, Dict[str, Tuple[str, str]]]:
    """Return the text with a name for each number that is made of an array, as in `min(laser)`.

    And what each name stands for: the reduction, and the array.
    """
    names: Dict[str, Tuple[str, str]] = {}

    def name(match: "re.Match[str]") -> str:
        reduction, array = REDUCTIONS[match.group(1)], match.group(2)
        if array not in arrays:
            return match.group()
        names[f"{array}_{reduction}"] = reduction, array
        return f"{array}_{reduction}"

    return _REDUCTION.sub(name, text), names


def inserted(condition: str, name: str, text: str) -> str:
    """Return a condition on the output of a function, as one on its inputs."""
    return re.sub(rf"\b{re.escape(name)}\b", lambda _: f"({text})", condition)

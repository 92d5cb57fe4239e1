"""Names for the services and properties of an unknown robot: from topics, fields and nodes."""
import re
from typing import Dict, Iterable, List, Sequence, Set

from shsa_core.language.syntax import is_name
from shsa_learning.init.survey import Publisher

LONGEST = 60
_GENERIC = (
    *("data", "raw", "state", "value", "status", "output", "measured"),
    *("left", "right", "front", "rear", "back", "top", "bottom"),
)
"""Last parts of a topic that say nothing without the one before."""
_LEVELS = 3


def service_names(publishers: Sequence[Publisher]) -> Dict[Publisher, str]:
    """Name each as short as the others allow: topics that end alike differ."""
    levels = dict.fromkeys(publishers, 0)
    for _ in range(_LEVELS - 1):
        groups: Dict[str, List[Publisher]] = {}
        for publisher in publishers:
            groups.setdefault(_stem(publisher, levels[publisher]), []).append(publisher)
        for group in groups.values():
            for publisher in group if len(group) > 1 else ():
                levels[publisher] += 1
    used: Set[str] = set()
    return {each: unique(_stem(each, levels[each]), used) for each in publishers}


def property_name(service: str, words: Iterable[str], used: Set[str]) -> str:
    """Return a name for what a service says; `used` are those that are taken, and takes it too."""
    name = _clean(words)
    first = name.split("_")[0]
    if first and f"_{service}".endswith(f"_{first}"):  # battery_state, state_of_charge
        name = name[len(first) :]
    return unique(_joined([service, name]), used)


def unique(name: str, used: Set[str]) -> str:
    """Return the name, with a number if it is taken; it is taken then."""
    found, number = name, 1
    while found in used:
        number += 1
        found = f"{name}_{number}"
    used.add(found)
    return found


def _stem(publisher: Publisher, level: int) -> str:
    parts = [part for part in publisher.topic.split("/") if part]
    if level == 0:
        parts = parts[-2:] if parts and _says_little(parts[-1]) else parts[-1:]
        if len(parts) > 1 and parts[-1] in ("data", "value"):
            parts = parts[:-1]
    if level > 1:
        parts.append(publisher.node)
    return _joined(parts)


def _says_little(part: str) -> bool:
    return part in _GENERIC or part.isdigit() or len(part) < 3


def _joined(parts: Iterable[str]) -> str:
    """Return a name that the language takes, of whatever texts."""
    name = _clean(parts)
    if name[:1].isdigit():
        name = "n" + name
    return name if is_name(name) or not name else f"{name}_value"


def _clean(parts: Iterable[str]) -> str:
    text = "_".join(parts)
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", text[: 4 * LONGEST]).lower()
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")[:LONGEST].strip("_")

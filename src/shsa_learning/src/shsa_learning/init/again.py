"""Widens a drafted SOM by another survey: what a person has changed in it stays."""
import os
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

from shsa_learning.init.survey import RATES

Tree = Dict[str, Any]


def drafted_path(som: str) -> str:
    """Return the file beside a SOM that keeps it as it was drafted."""
    root, ending = os.path.splitext(som)
    return f"{root}.drafted{ending}"


def widen(som: Tree, drafted: Tree, fresh: Tree) -> List[str]:
    """Widen what was drafted by a fresh draft, in both trees; return what changed, in words.

    Services are told by topic and node, values by their field. A number that is another one in the
    SOM than it was drafted is a person's, and stays; so does what a person has taken out.
    """
    told: List[str] = []
    mine, before = _by_publisher(som), _by_publisher(drafted)
    for key, (name, service) in _by_publisher(fresh).items():
        if key in mine and key in before:
            told += _service(mine[key][0], mine[key][1], before[key][1], service)
        elif key not in before and name not in {*som["services"], *drafted["services"]}:
            told.append(f"{name}: {key[0]} of {key[1]} is new: draft it into another file")
    return told


def _service(name: str, som: Tree, drafted: Tree, fresh: Tree) -> Iterator[str]:
    period = _longer(drafted["period"], fresh["period"])
    yield from _set(f"{name}: period", "period", period, som, drafted)
    contain = fresh.get("contain", drafted.get("contain"))
    yield from _set(f"{name}: contain", "contain", contain, som, drafted)
    mine, before = _by_field(som), _by_field(drafted)
    for field, (property_, value) in _by_field(fresh).items():
        if field not in before:
            yield f"{name}: {field} changes as well: add it under `provides` if it matters"
        elif field in mine:
            wider = _wider(before[field][1].get("usual"), value.get("usual"))
            what = f"{name}: usual of {mine[field][0]}"
            yield from _set(what, "usual", wider, mine[field][1], before[field][1])


def _set(what: str, key: str, value: Any, som: Tree, drafted: Tree) -> Iterator[str]:
    """Set a number that was drafted, and not changed since."""
    old = drafted.get(key)
    if value == old:
        return
    if som.get(key) != old:
        yield f"{what} stays {som.get(key, 'unsaid')}, as somebody wrote; {value} was seen"
        return
    yield f"{what} is {value}, it was {drafted.get(key, 'unsaid')}"
    som[key] = drafted[key] = value


def _longer(old: Any, fresh: Any) -> Any:
    """Return the period for both; none: it varies."""
    if "none" in (old, fresh):
        return "none"
    return max(old, fresh) if max(old, fresh) <= RATES[1] * min(old, fresh) else "none"


def _wider(old: Optional[List[float]], fresh: Optional[List[float]]) -> Optional[List[float]]:
    """Return the interval that holds both; a value without one has no limits."""
    if old is None or fresh is None:
        return old
    return [min(old[0], fresh[0]), max(old[1], fresh[1])]


def _by_publisher(tree: Tree) -> Mapping[Tuple[str, str], Tuple[str, Tree]]:
    named = (tree.get("services") or {}).items()
    return {(each["topic"], each["node"]): (name, each) for name, each in named}


def _by_field(service: Tree) -> Mapping[str, Tuple[str, Tree]]:
    return {each["field"]: (name, each) for name, each in service["provides"].items()}

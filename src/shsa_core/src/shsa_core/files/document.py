"""Values from a YAML file or from the parameter server, each with the place where it stands."""
import math
import re
from dataclasses import dataclass
from typing import Any, Dict, Iterable, Iterator, List, Tuple, Union

import yaml  # type: ignore[import]

from shsa_core.errors import ModelError
from shsa_core.files.regular import read_text
from shsa_core.text import nearest, short

MAX_DEPTH = 20

_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?\Z")
_WORDS: Dict[str, Union[None, bool, float]] = {
    "": None,
    "~": None,
    "null": None,
    "true": True,
    "false": False,
    ".nan": math.nan,
    ".inf": math.inf,
    "-.inf": -math.inf,
}


_SLIPS = {
    r"[^|]*\|[^|]*\|\t": "a tab; indent with spaces",
    # a word that begins with a character that YAML keeps for itself
    r"[^|]*start any token\|[^|]*\|([^,}\]\s']{1,20})(?![^,}\]\s]*')": "put it in quotes: '{}'",
    r"mapping values are not allowed[^|]*\|[^|]*: [^|]*\|": "put a text that has a colon in quotes",
    r"mapping values are not allowed": "the line before lacks a colon or a space after it, "
    "or this one is indented too far",
    r"could not find expected ':'": "this line lacks a colon, or a space after it",
    r"did not find expected key\|\s*\|": "its indentation differs from that of the lines above",
    r"did not find expected key": "a quote or a bracket ends too soon, or one above has no end",
    r"found unexpected end of stream": "the quote that begins here has no end",
    r"did not find expected ',' or": "a comma is missing, or the bracket of line {} has no end",
}
"""Usual slips, by YAML's problem, what stands before it in the line, and what begins there."""


class Foreign:
    """The content of a value that no file can have."""


_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class Value:
    """One value: nothing, a flag, a number, a text, a list or a mapping, or Foreign.

    `text` is how a plain value was written, or what a foreign one is.
    """

    where: str
    data: Union[None, bool, float, str, List["Value"], Dict[str, "Value"], Foreign]
    text: str = ""

    def error(self, what: str) -> ModelError:
        """Return the error that says `what` is wrong here."""
        return ModelError(self.where, what)

    def mapping(self, what: str) -> Dict[str, "Value"]:
        """Return the mapping that this value must be."""
        return self._must(dict, what, "a mapping (name: value)")

    def wrong_keys(
        self, what: str, allowed: Iterable[str], required: Iterable[str] = ()
    ) -> Iterator[ModelError]:
        """Yield what is wrong with the keys of this mapping."""
        values = self.mapping(what)
        allowed = list(allowed)
        for key, value in values.items():
            if key not in allowed:
                known = f"{', '.join(allowed)}{nearest(key, allowed)}"
                yield value.error(f"{what} has no key '{key}'; allowed: {known}")
        for key in required:
            if key not in values:
                yield self.error(f"{what} lacks the key '{key}'")

    def sequence(self, what: str) -> List["Value"]:
        """Return the list that this value must be."""
        return self._must(list, what, "a list")

    def number(self, what: str) -> float:
        """Return the finite number that this value must be."""
        found: float = self._must(float, what, "a number")
        if not math.isfinite(found):
            raise self.error(f"{what} must be a finite number, not {self.describe()}")
        return found

    def interval(self, what: str) -> Tuple[float, float]:
        """Return the lowest and the highest number, in a list, that this value must be."""
        items = self.sequence(f"{what}, [lowest, highest],")
        if len(items) != 2:
            given = short(", ".join(item.describe() for item in items))
            raise self.error(f"{what} must be two numbers, [lowest, highest], not [{given}]")
        lowest, highest = items[0].number(f"{what}'s lowest"), items[1].number(f"{what}'s highest")
        if lowest >= highest:
            raise self.error(f"{what} must have its lowest first, not [{lowest:g}, {highest:g}]")
        return (lowest, highest)

    def flag(self, what: str) -> bool:
        """Return the true or false that this value must be."""
        return self._must(bool, what, "true or false")

    def string(self, what: str) -> str:
        """Return the text that this value must be; a number counts as it was written."""
        self._must((bool, float, str), what, "a text")
        return self.text

    def _must(self, kind: Any, what: str, form: str) -> Any:
        if not isinstance(self.data, kind):
            raise self.error(f"{what} must be {form}, not {self.describe()}")
        return self.data

    def describe(self) -> str:
        """Return the value in a few words."""
        if self.data is None:
            return "empty"
        if isinstance(self.data, dict):
            return "a mapping"
        if isinstance(self.data, list):
            return "a list"
        text = short(self.text)
        return f"the text {text!a}" if isinstance(self.data, str) else text


Entry = Dict[str, Value]


def read_yaml(path: str) -> Value:
    """Return the one document of a YAML file. Raises ModelError, with file and line."""
    return parse_yaml(read_text(str(path)), str(path))


def parse_yaml(text: str, name: str) -> Value:
    """Return the one document of a YAML text; `name` stands for the file in errors."""
    events = yaml.parse(text, Loader=_Loader)
    root = Value(f"{name}:1", None)
    try:
        for event in events:
            if isinstance(event, yaml.NodeEvent):
                root = _value(event, events, name, 0)
                break
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                raise ModelError(_where(event, name), "a second document begins; a file has one")
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error)
        if mark:
            line = "".join(text.splitlines()[mark.line : mark.line + 1])
            seen = f"{problem}|{line[: mark.column]}|{line[mark.column :]}"
            found = ((re.match(slip, seen), hint) for slip, hint in _SLIPS.items())
            top = error.context_mark.line + 1 if error.context_mark else 0
            problem += next((": " + hint.format(*it.groups(), top) for it, hint in found if it), "")
            if error.context in ("while scanning a quoted scalar", "while scanning a simple key"):
                mark = error.context_mark  # what is wrong is where that begins
        where = f"{name}:{mark.line + 1}" if mark else name
        raise ModelError(where, f"is not valid YAML: {problem}") from error
    return root


def from_parameters(value: object, where: str, depth: int = 0) -> Value:
    """Return a value of the parameter server, which has the name `where`, as a Value."""
    if depth > MAX_DEPTH:
        return Value(where, Foreign(), f"nested more than {MAX_DEPTH} deep")
    if isinstance(value, dict):
        items = value.items()
        return Value(
            where, {str(k): from_parameters(v, f"{where}/{k}", depth + 1) for k, v in items}
        )
    if isinstance(value, (list, tuple)):
        pairs = enumerate(value)
        return Value(where, [from_parameters(v, f"{where}[{i}]", depth + 1) for i, v in pairs])
    if value is None or isinstance(value, bool):
        return Value(where, value, str(value).lower())
    if isinstance(value, (int, float)):
        try:
            return Value(where, float(value), repr(value))
        except OverflowError:
            return Value(where, math.inf, repr(value))
    if isinstance(value, str):
        return Value(where, value, value)
    return Value(where, Foreign(), f"a {type(value).__name__}")


def _value(event: yaml.Event, events: Iterator[yaml.Event], name: str, depth: int) -> Value:
    where = _where(event, name)
    if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
        raise ModelError(where, "anchors (&) and aliases (*) are not allowed")
    if event.tag is not None:
        raise ModelError(where, f"tags are not allowed: {event.tag}")
    if isinstance(event, yaml.ScalarEvent):
        return Value(where, _scalar(event), event.value)
    if depth >= MAX_DEPTH:
        raise ModelError(where, f"is nested more than {MAX_DEPTH} deep")
    items: List[Value] = []
    entries: Entry = {}
    for inner in events:
        if isinstance(inner, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
            break
        value = _value(inner, events, name, depth + 1)
        if isinstance(event, yaml.SequenceStartEvent):
            items.append(value)
            continue
        if not isinstance(inner, yaml.ScalarEvent):
            raise value.error("a key must be a plain text")
        if inner.value in entries:
            raise value.error(f"the key '{inner.value}' stands here a second time")
        held = _value(next(events), events, name, depth + 1)
        entries[inner.value] = Value(value.where, held.data, held.text)
    return Value(where, items if isinstance(event, yaml.SequenceStartEvent) else entries)


def _scalar(event: yaml.ScalarEvent) -> Union[None, bool, float, str]:
    text: str = event.value
    if event.style:
        return text
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    return float(text) if _NUMBER.match(text) else text


def _where(event: yaml.Event, name: str) -> str:
    return f"{name}:{event.start_mark.line + 1}"

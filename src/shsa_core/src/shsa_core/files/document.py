"""Values from a YAML file or from the parameter server, each with the place where it stands."""
import math
import re
from dataclasses import dataclass
from typing import Dict, Iterable, Iterator, List, Optional, Tuple, Union

import yaml  # type: ignore[import]

from shsa_core.errors import ModelError
from shsa_core.files.regular import read_text
from shsa_core.text import nearest

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
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class Value:
    """One value: nothing, a flag, a number, a text, a list or a mapping.

    `text` is how a plain value was written.
    """

    where: str
    data: Union[None, bool, float, str, List["Value"], Dict[str, "Value"]]
    text: str = ""

    def error(self, what: str) -> ModelError:
        """Return the error that says `what` is wrong here."""
        return ModelError(self.where, what)

    def mapping(self, what: str) -> Dict[str, "Value"]:
        """Return the mapping that this value must be."""
        if not isinstance(self.data, dict):
            raise self.error(f"{what} must be a mapping (name: value), not {self.describe()}")
        return self.data

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
        if not isinstance(self.data, list):
            raise self.error(f"{what} must be a list, not {self.describe()}")
        return self.data

    def number(self, what: str) -> float:
        """Return the finite number that this value must be."""
        if not isinstance(self.data, float):
            raise self.error(f"{what} must be a number, not {self.describe()}")
        if not math.isfinite(self.data):
            raise self.error(f"{what} must be a finite number, not {self.describe()}")
        return self.data

    def interval(self, what: str) -> Tuple[float, float]:
        """Return the lowest and the highest number, in a list, that this value must be."""
        items = self.sequence(f"{what}, [lowest, highest],")
        if len(items) != 2:
            raise self.error(f"{what} must be two numbers, [lowest, highest], not {len(items)}")
        lowest, highest = items[0].number(f"{what}'s lowest"), items[1].number(f"{what}'s highest")
        if lowest >= highest:
            raise self.error(f"{what} must have its lowest first, not [{lowest:g}, {highest:g}]")
        return (lowest, highest)

    def flag(self, what: str) -> bool:
        """Return the true or false that this value must be."""
        if not isinstance(self.data, bool):
            raise self.error(f"{what} must be true or false, not {self.describe()}")
        return self.data

    def string(self, what: str) -> str:
        """Return the text that this value must be; a number counts as it was written."""
        if isinstance(self.data, (list, dict)) or self.data is None:
            raise self.error(f"{what} must be a text, not {self.describe()}")
        return self.text

    def describe(self) -> str:
        """Return the value in a few words."""
        if self.data is None:
            return "empty"
        if isinstance(self.data, dict):
            return "a mapping"
        if isinstance(self.data, list):
            return "a list"
        text = self.text if len(self.text) <= 60 else self.text[:57] + "..."
        return f"the text {text!a}" if isinstance(self.data, str) else text


Entry = Dict[str, Value]


def read_yaml(path: str) -> Value:
    """Return the one document of a YAML file. Tags, anchors and aliases are refused.

    Nothing in the file is run.

    Raises ModelError, with file and line, if the file cannot be read.
    """
    return parse_yaml(read_text(str(path)), str(path))


def parse_yaml(text: str, name: str) -> Value:
    """Return the one document of a YAML text; `name` stands for the file in errors."""
    builder = _Builder(name)
    try:
        for event in yaml.parse(text, Loader=_Loader):
            builder.take(event)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{name}:{mark.line + 1}" if mark else name
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error)
        if mark and problem.endswith("cannot start any token"):
            problem += _quoted(text.splitlines()[mark.line][mark.column :])
        raise ModelError(where, f"is not valid YAML: {problem}") from error
    return builder.result()


def _quoted(rest: str) -> str:
    # a word that begins with a character that YAML keeps for itself
    word = re.split(r"[,}\]\s]", rest)[0][:20]
    return f": put it in quotes: '{word}'" if word and "'" not in word else ""


def from_parameters(value: object, where: str) -> Value:
    """Return a value of the parameter server as a Value; `where` is the parameter's name."""
    return _from_parameters(value, where, 0)


def _from_parameters(value: object, where: str, depth: int) -> Value:
    if depth > MAX_DEPTH:
        raise ModelError(where, f"is nested more than {MAX_DEPTH} deep")
    if isinstance(value, dict):
        entries = {str(k): _from_parameters(v, f"{where}/{k}", depth + 1) for k, v in value.items()}
        return Value(where, entries)
    if isinstance(value, (list, tuple)):
        items = [_from_parameters(v, f"{where}[{i}]", depth + 1) for i, v in enumerate(value)]
        return Value(where, items)
    if value is None or isinstance(value, bool):
        return Value(where, value, str(value).lower())
    if isinstance(value, (int, float)):
        try:
            return Value(where, float(value), repr(value))
        except OverflowError:
            return Value(where, math.inf, repr(value))
    if isinstance(value, str):
        return Value(where, value, value)
    raise ModelError(
        where, f"a {type(value).__name__} is not allowed; give numbers, texts, lists or mappings"
    )


class _Builder:
    """Builds a Value from the events of a YAML parser, without recursion."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._open: List[Tuple[Value, List[Tuple[str, str]]]] = []
        self._root: Optional[Value] = None
        self._documents = 0

    def take(self, event: yaml.Event) -> None:
        """Take the next event of the parser."""
        where = f"{self._name}:{event.start_mark.line + 1}"
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                raise ModelError(where, "a second document begins; a file has one")
        elif isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            raise ModelError(where, "anchors (&) and aliases (*) are not allowed")
        elif getattr(event, "tag", None) is not None:
            raise ModelError(where, f"tags are not allowed: {event.tag}")
        elif isinstance(event, yaml.ScalarEvent):
            self._scalar(event, where)
        elif isinstance(event, yaml.MappingStartEvent):
            self._begin(Value(where, {}))
        elif isinstance(event, yaml.SequenceStartEvent):
            self._begin(Value(where, []))
        elif isinstance(event, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
            self._add(self._open.pop()[0])

    def result(self) -> Value:
        """Return what the events made."""
        if self._root is None:
            return Value(f"{self._name}:1", None)
        return self._root

    def _begin(self, value: Value) -> None:
        if self._expects_key():
            raise value.error("a key must be a plain text")
        if len(self._open) >= MAX_DEPTH:
            raise value.error(f"is nested more than {MAX_DEPTH} deep")
        self._open.append((value, []))

    def _expects_key(self) -> bool:
        return (
            bool(self._open) and isinstance(self._open[-1][0].data, dict) and not self._open[-1][1]
        )

    def _scalar(self, event: yaml.ScalarEvent, where: str) -> None:
        if self._expects_key():
            parent, key = self._open[-1]
            assert isinstance(parent.data, dict)
            if event.value in parent.data:
                raise ModelError(where, f"the key '{event.value}' stands here a second time")
            key.append((event.value, where))
            return
        data: Union[None, bool, float, str] = event.value
        if not event.style:
            word = event.value.lower()
            if word in _WORDS:
                data = _WORDS[word]
            elif _NUMBER.match(event.value):
                data = float(event.value)
        self._add(Value(where, data, event.value))

    def _add(self, value: Value) -> None:
        if not self._open:
            self._root = value
            return
        parent, key = self._open[-1]
        if isinstance(parent.data, dict):
            name, where = key.pop()
            parent.data[name] = Value(where, value.data, value.text)
        elif isinstance(parent.data, list):
            parent.data.append(value)

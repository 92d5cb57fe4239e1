"""Reads mappings by a table of their keys, and writes them as plain values again."""
import dataclasses
import re
import sys
from types import MappingProxyType
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Tuple, Type, Union

from shsa_core.errors import ModelError, ModelErrors, ShsaError
from shsa_core.files.document import Value
from shsa_core.model.error import Error
from shsa_core.model.kinds import Word

ABOVE_0 = 5e-324  # the smallest number there is
HIGHEST = sys.float_info.max
MAX_NAME = 255


class Reader(NamedTuple):
    """Reads the value that stands under a key; `form`: what is written there.

    `read` gets the value and its key, and raises ModelError if it is not of that form.
    """

    form: str
    read: Callable[[Value, str], Any]


class Key(NamedTuple):
    """A key of a mapping: its reader, and what it means.

    `basic`: a first robot needs it; the others are for experts.
    """

    reader: Reader
    means: str
    basic: bool = False
    required: bool = False


Keys = Mapping[str, Key]


def required(reader: Reader, means: str) -> Key:
    """Return a basic key that must be there."""
    return Key(reader, means, basic=True, required=True)


def basic(reader: Reader, means: str) -> Key:
    """Return a key that a first robot needs."""
    return Key(reader, means, basic=True)


def read_entry(value: Value, what: str, keys: Keys, within: str = "") -> Dict[str, Any]:
    """Return what a mapping says under its keys. Raises ModelErrors: all that is wrong with it."""
    given, errors = read_keys(value, what, keys, within)
    if errors:
        raise ModelErrors(errors)
    return given


def read_keys(
    value: Value, what: str, keys: Keys, within: str = ""
) -> Tuple[Dict[str, Any], List[ModelError]]:
    """Return what a mapping says under its valid keys, and all that is wrong with it.

    `within` stands before the name of a key in errors. Raises ModelError if it is no mapping.
    """
    given: Dict[str, Any] = {}
    errors = list(value.wrong_keys(what, keys, [key for key in keys if keys[key].required]))
    for key, item in value.mapping(what).items():
        try:
            if key in keys:
                given[key] = keys[key].reader.read(item, within + key)
        except ModelError as error:
            errors += error.errors
    return given, errors


def plain_entry(item: Any, keys: Optional[Keys] = None) -> Dict[str, Any]:
    """Return a mapping as it is written: basic keys, and others that are not as by default."""
    usual = {field.name: field.default for field in dataclasses.fields(item)}
    values = {key: getattr(item, key) for key in keys or usual if key in usual}
    given = [key for key, each in (keys or {}).items() if each.basic]
    said = {key: it for key, it in values.items() if it != usual[key] or key in given}
    return {key: plain(it) for key, it in said.items() if it is not None}


def plain(value: Any) -> Any:
    """Return a value of the model as it is written: numbers, texts, lists and mappings."""
    if isinstance(value, Error) and value == Error(value.rms):
        return value.rms
    if isinstance(value, Word):
        return str(value)
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    if dataclasses.is_dataclass(value):
        return plain_entry(value)
    return value


text = Reader("text", Value.string)
flag = Reader("true or false", Value.flag)
number = Reader("number", Value.number)
interval = Reader("[lowest, highest]", Value.interval)
mapping = Reader("mapping", Value.mapping)


def _reader(form: str, must: str, make: Callable[[Value], Any]) -> Reader:
    """Return a reader of what `make` makes of a value; ValueError: it is not what it `must` be."""

    def read(value: Value, key: str) -> Any:
        try:
            return make(value)
        except (ValueError, ModelError) as error:
            raise value.error(f"{key} must be {must}, not {value.describe()}") from error

    return Reader(form, read)


def number_in(
    lowest: float,
    highest: float,
    form: str,
    words: Mapping[Union[bool, str], Optional[float]] = MappingProxyType({}),
    whole: bool = False,
) -> Reader:
    """Return a reader of a number within limits, or of a word that stands for something."""

    def make(value: Value) -> Optional[float]:
        data = value.data
        if isinstance(data, (bool, str)) and data in words:
            return words[data]
        if isinstance(data, float) and lowest <= data <= highest and not (whole and data % 1.0):
            return int(data) if whole else data
        raise ValueError

    return _reader(form, form, make)


positive = number_in(ABOVE_0, HIGHEST, "above 0")
not_negative = number_in(0.0, HIGHEST, "0 or above")
share = number_in(ABOVE_0, 1.0, "above 0 and at most 1")


def whole_number(highest: int, lowest: int = 1) -> Reader:
    """Return a reader of a whole number."""
    return number_in(lowest, highest, f"a whole number from {lowest} to {highest}", whole=True)


def matching(pattern: "re.Pattern[str]", example: str) -> Reader:
    """Return a reader of a text that has a pattern."""

    def make(value: Value) -> str:
        text = value.string(example)
        if len(text) > MAX_NAME or not pattern.match(text):
            raise ValueError
        return text

    return _reader(f"like {example}", f"written like {example}", make)


def one_of(words: Type[Word]) -> Reader:
    """Return a reader of one of some words."""
    form = ", ".join(str(each) for each in words)
    return _reader(form, f"one of {form}", lambda value: words(value.string(form)))


def parsed(form: str, parse: Callable[[str], Any]) -> Reader:
    """Return a reader of a text by a function that raises a ShsaError."""

    def read(value: Value, key: str) -> Any:
        found = value.string(key)
        try:
            return parse(found)
        except ShsaError as error:
            raise value.error(f"{key}: {error}") from error

    return Reader(form, read)


def list_of(reader: Reader, form: str) -> Reader:
    """Return a reader of a list; what stands there twice counts once."""

    def read(value: Value, key: str) -> Tuple[Any, ...]:
        items = value.sequence(key)
        return tuple(dict.fromkeys(reader.read(item, f"a name in {key}") for item in items))

    return Reader(form, read)

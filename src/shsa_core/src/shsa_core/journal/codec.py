"""Values as JSON and back without loss: written by what they are, read by what they must be.

Nothing else is read, and nothing is run.
"""
import base64
import collections.abc
import dataclasses
import enum
import json
from functools import lru_cache, partial
from math import inf, isfinite, nan
from operator import attrgetter
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Sequence, Tuple
from typing import Union, get_args, get_origin, get_type_hints

from shsa_core.dispatch import members
from shsa_core.errors import ModelError, ShsaError
from shsa_core.language.expression import Condition, Law, parse_constraint, parse_law
from shsa_core.model.cost import Host
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.text import short

CLASS = "class"
"""The key of an object's class; no field can have this name."""
Write = Callable[[Any], Any]
Read = Callable[[Any, str], Any]
"""Return the value of some data; the text names its place. Raises _Refused."""


class Form(NamedTuple):
    """The form of a class that is no dataclass, or that must be checked when it is read.

    It is written as the value of type `hint` that `take` makes of it, and `make` reverses that.
    """

    hint: Any
    take: Callable[[Any], Any]
    make: Callable[[Any], Any]


FORMS: Mapping[type, Form] = {
    Som: Form(
        Tuple[Tuple[Service, ...], Tuple[Host, ...], bool],
        attrgetter("parts"),
        lambda parts: Som(*parts),
    ),
    Law: Form(str, attrgetter("text"), parse_law),
    Condition: Form(str, attrgetter("text"), parse_constraint),
    bytes: Form(
        str,
        lambda data: base64.b64encode(data).decode("ascii"),
        lambda text: base64.b64decode(text, validate=True),
    ),
}
_ENDLESS = {"inf": inf, "-inf": -inf, "nan": nan}


class Codec:
    """The JSON form of a type, as of a dataclass or of a union of them, with all that they hold.

    Raises TypeError for a type that has no such form.
    """

    def __init__(self, hint: Any) -> None:
        hints = _members(hint)
        self._types = tuple(get_origin(each) or each for each in hints)
        self._read = _reader(Union[hints])

    def encode(self, value: Any) -> Any:
        """Return the value as what `json` writes. Raises TypeError if it is not of the type."""
        if not isinstance(value, self._types):
            names = ", ".join(each.__name__ for each in self._types)
            raise TypeError(f"{value!r} is none of {names}")
        return _write(value)

    def decode(self, data: Any, where: str, what: str) -> Any:
        """Return the value of which `encode` made `data`. Raises ModelError if there is none.

        `what` is its name in errors, `where` the file and line.
        """
        try:
            return self._read(data, what)
        except _Refused as refused:
            raise ModelError(where, str(refused)) from refused

    def to_text(self, value: Any) -> str:
        """Return the value as one line of JSON. Raises TypeError as `encode` does."""
        return json.dumps(self.encode(value))

    def from_text(self, text: str, where: str, what: str) -> Any:
        """Return the value of which `to_text` made a text. Raises ModelError if there is none."""
        try:
            return self.decode(json.loads(text), where, what)
        except (ValueError, RecursionError) as error:
            raise ModelError(where, f"{what} is no JSON: {error}") from error


class _Refused(Exception):
    """Some data is not the form of the type."""


def _members(hint: Any) -> Tuple[Any, ...]:
    many = get_origin(hint) is Union or (isinstance(hint, type) and hint not in FORMS)
    return members(hint) if many else (hint,)


def _write(value: Any) -> Any:
    kind: Any = type(value)
    return _writer(kind)(value)


@lru_cache(maxsize=None)
def _writer(type_: Any) -> Write:
    if type_ in FORMS:
        take = FORMS[type_].take
        return lambda value: _write(take(value))
    if issubclass(type_, enum.Enum):
        return lambda value: value.value
    if issubclass(type_, float):
        return lambda value: value if isfinite(value) else repr(float(value))
    if type_ in _PLAIN:
        return lambda value: value
    if issubclass(type_, (tuple, list)):
        return lambda value: [_write(each) for each in value]
    if issubclass(type_, (frozenset, set)):  # in order, so that equal sets are equal text
        return lambda value: sorted(_write(each) for each in value)
    if issubclass(type_, collections.abc.Mapping):
        return lambda value: {name: _write(each) for name, each in value.items()}
    if dataclasses.is_dataclass(type_):
        names = [each.name for each in dataclasses.fields(type_) if each.init]
        head = {CLASS: type_.__name__}
        return lambda value: {**head, **{name: _write(getattr(value, name)) for name in names}}
    raise TypeError(f"{type_.__name__} has no form in JSON")


@lru_cache(maxsize=None)
def _reader(hint: Any) -> Read:
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in FORMS:
        form, inner = FORMS[hint], _reader(FORMS[hint].hint)
        return lambda data, path: _made(hint, lambda: form.make(inner(data, path)), path)
    if origin is Union:
        return _read_union(arguments)
    if origin is tuple and arguments[-1] is not Ellipsis:
        return partial(_read_fixed, [_reader(each) for each in arguments])
    if origin in (tuple, collections.abc.Sequence):
        return partial(_read_many, tuple, _reader(arguments[0]))
    if origin is frozenset and arguments[0] in (str, int):
        return partial(_read_many, frozenset, _reader(arguments[0]))
    if origin is collections.abc.Mapping and arguments[0] is str:
        return partial(_read_named, _reader(arguments[1]))
    if hint is float:
        return _read_float
    if hint in _PLAIN:
        return lambda data, path: _expect(hint, data, path, f"a value of the type {hint.__name__}")
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return partial(_read_enum, {member.value: member for member in hint})
    if dataclasses.is_dataclass(hint):
        return _read_object([hint])
    raise TypeError(f"a journal has no form for {hint}")


_PLAIN = (type(None), bool, int, str)


def _read_union(types: Sequence[Any]) -> Read:
    """Read what the first member takes that takes it; objects are told apart by their classes."""
    records = [each for each in types if dataclasses.is_dataclass(each) and each not in FORMS]
    skipped = (*records, type(None), *([int] if float in types else []))  # a float reads both
    members = [_reader(each) for each in types if each not in skipped]
    members += [_read_object(records)] if records else []
    may_lack = type(None) in types

    def read(data: Any, path: str) -> Any:
        if data is None and may_lack:
            return None
        for member in members[:-1]:
            try:
                return member(data, path)
            except _Refused:
                continue
        return members[-1](data, path)

    return read


def _read_object(types: Iterable[Any]) -> Read:
    """Read an object of some dataclasses and those derived; where there is one, it is not named."""
    classes = [each for type_ in types for each in _descent(type_)]
    fields = {each.__name__: (each, _fields(each)) for each in classes}
    if len(fields) < len(classes):
        raise TypeError(f"two classes have one name among {', '.join(fields)}")
    only = classes[0].__name__ if len(classes) == 1 else None

    def read(data: Any, path: str) -> Any:
        _expect(dict, data, path, "an object")
        name = data.get(CLASS, only)
        if type(name) is not str or name not in fields:
            raise _Refused(f"{path}: there is no class {name!a}; there are {', '.join(fields)}")
        type_, readers = fields[name]
        values = {}
        for key, each in data.items():
            if key in readers:
                values[key] = readers[key](each, f"{path}.{key}")
            elif key != CLASS:
                raise _Refused(f"{path}: {name} has no field {key!a}")
        return _made(type_, lambda: type_(**values), path)

    return read


def _descent(type_: Any) -> List[Any]:
    return [type_, *(each for child in type_.__subclasses__() for each in _descent(child))]


@lru_cache(maxsize=None)
def _fields(type_: Any) -> Dict[str, Read]:
    hints = get_type_hints(type_)
    return {f.name: _reader(hints[f.name]) for f in dataclasses.fields(type_) if f.init}


def _read_float(data: Any, path: str) -> Any:
    if type(data) is str and data in _ENDLESS:
        return _ENDLESS[data]
    if type(data) not in (int, float):
        raise _refusal(path, "a number", data)
    return data


def _read_enum(members: Mapping[Any, Any], data: Any, path: str) -> Any:
    if type(data) not in (str, int) or data not in members:
        raise _refusal(path, f"one of {', '.join(map(str, members))}", data)
    return members[data]


def _read_many(kind: Any, each: Read, data: Any, path: str) -> Any:
    items = enumerate(_expect(list, data, path, "a list"))
    return kind([each(item, f"{path}[{n}]") for n, item in items])


def _read_fixed(places: Sequence[Read], data: Any, path: str) -> Any:
    if type(data) is not list or len(data) != len(places):
        raise _refusal(path, f"a list of {len(places)}", data)
    pairs = enumerate(zip(places, data))
    return tuple(place(each, f"{path}[{n}]") for n, (place, each) in pairs)


def _read_named(each: Read, data: Any, path: str) -> Any:
    items = _expect(dict, data, path, "an object").items()
    return {name: each(item, f"{path}.{name}") for name, item in items}


def _made(type_: type, make: Callable[[], Any], path: str) -> Any:
    try:
        return make()
    except (TypeError, ValueError, ShsaError) as error:
        raise _Refused(f"{path} is no {type_.__name__}: {error}") from error


def _expect(type_: type, data: Any, path: str, wanted: str) -> Any:
    if type(data) is not type_:
        raise _refusal(path, wanted, data)
    return data


def _refusal(path: str, wanted: str, data: Any) -> _Refused:
    return _Refused(f"{path} must be {wanted}, not {short(repr(data))}")

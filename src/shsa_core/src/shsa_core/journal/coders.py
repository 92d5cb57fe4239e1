"""The JSON forms of types: one class a sort of type."""
import base64
import enum
from math import inf, isfinite, nan
from typing import (
    Any,
    Callable,
    ClassVar,
    Dict,
    FrozenSet,
    Iterable,
    List,
    NamedTuple,
    Sequence,
    Tuple,
)

from shsa_core.errors import ShsaError

CLASS = "class"
"""The key that tells which class an object is of, where several are possible; no field can have
this name.
"""
_NULL, _FLAG, _NUMBER, _TEXT, _LIST, _OBJECT = "null", "flag", "number", "text", "list", "object"
_ENDLESS = {"inf": inf, "-inf": -inf, "nan": nan}


class Form(NamedTuple):
    """How a class that is no dataclass is written: as what type, and how it is made again."""

    hint: Any
    take: Callable[[Any], Any]
    make: Callable[[Any], Any]


class Refused(Exception):
    """Some data is not the form of the type."""


class Coder:
    """The form of one type; `kinds` are the sorts of JSON values that it has."""

    kinds: FrozenSet[str]

    def encode(self, value: Any) -> Any:
        raise NotImplementedError

    def decode(self, data: Any, path: str) -> Any:
        raise NotImplementedError


class PlainCoder(Coder):
    """Nothing, a flag, a whole number or a text."""

    _KINDS: ClassVar[Dict[type, str]] = {type(None): _NULL, bool: _FLAG, int: _NUMBER, str: _TEXT}

    def __init__(self, type_: type) -> None:
        self._type = type_
        self.kinds = frozenset([self._KINDS[type_]])

    def encode(self, value: Any) -> Any:
        if not isinstance(value, self._type) or type(value) is bool is not self._type:
            raise TypeError(f"{value!r} is no {self._type.__name__}")
        return value

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is not self._type:
            raise _refusal(path, f"a value of the type {self._type.__name__}", data)
        return data


class FloatCoder(Coder):
    """A number; those that JSON lacks are texts."""

    kinds = frozenset([_NUMBER, _TEXT])

    def encode(self, value: Any) -> Any:
        if type(value) is not float:
            if not isinstance(value, (int, float)) or type(value) is bool:
                raise TypeError(f"{value!r} is no number")
            value = float(value) if isinstance(value, float) else int(value)
        return value if isfinite(value) else repr(value)

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is str and data in _ENDLESS:
            return _ENDLESS[data]
        if type(data) not in (int, float):
            raise _refusal(path, "a number", data)
        return data


class BytesCoder(Coder):
    """Bytes, as the text of their base 64."""

    kinds = frozenset([_TEXT])

    def encode(self, value: Any) -> Any:
        if not isinstance(value, bytes):
            raise TypeError(f"{value!r} is no bytes")
        return base64.b64encode(value).decode("ascii")

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is not str:
            raise _refusal(path, "bytes in base 64", data)
        try:
            return base64.b64decode(data, validate=True)
        except ValueError as error:
            raise _refusal(path, "bytes in base 64", data) from error


class EnumCoder(Coder):
    """A member of an enumeration, by its value."""

    def __init__(self, type_: Any) -> None:
        self._type = type_
        self._members = {member.value: member for member in type_}
        self.kinds = frozenset(kind_of(value) for value in self._members)

    def encode(self, value: Any) -> Any:
        return self._type(value).value if type(value) is not self._type else value.value

    def decode(self, data: Any, path: str) -> Any:
        if type(data) not in (str, int) or data not in self._members:
            allowed = ", ".join(str(each) for each in self._members)
            raise _refusal(path, f"one of {allowed}", data)
        return self._members[data]


class ManyCoder(Coder):
    """A tuple of any number of equals."""

    kinds = frozenset([_LIST])

    def __init__(self, each: Coder) -> None:
        self._each = each

    def encode(self, value: Any) -> Any:
        if not isinstance(value, (tuple, list)):
            raise TypeError(f"{value!r} is no sequence")
        encode = self._each.encode
        return [encode(each) for each in value]

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is not list:
            raise _refusal(path, "a list", data)
        decode = self._each.decode
        return tuple([decode(each, f"{path}[{number}]") for number, each in enumerate(data)])


class SetCoder(Coder):
    """A set of texts or numbers, in order, so that equal sets are equal text."""

    kinds = frozenset([_LIST])

    def __init__(self, each: Coder) -> None:
        self._each = each

    def encode(self, value: Any) -> Any:
        if not isinstance(value, (frozenset, set)):
            raise TypeError(f"{value!r} is no set")
        return sorted(self._each.encode(each) for each in value)

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is not list:
            raise _refusal(path, "a list", data)
        return frozenset(self._each.decode(each, f"{path}[{n}]") for n, each in enumerate(data))


class FixedCoder(Coder):
    """A tuple with a type for each place."""

    kinds = frozenset([_LIST])

    def __init__(self, places: Sequence[Coder]) -> None:
        self._places = places

    def encode(self, value: Any) -> Any:
        if not isinstance(value, (tuple, list)) or len(value) != len(self._places):
            raise TypeError(f"{value!r} is no sequence of {len(self._places)}")
        return [place.encode(each) for place, each in zip(self._places, value)]

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is not list or len(data) != len(self._places):
            raise _refusal(path, f"a list of {len(self._places)}", data)
        pairs = enumerate(zip(self._places, data))
        return tuple(place.decode(each, f"{path}[{n}]") for n, (place, each) in pairs)


class NamedCoder(Coder):
    """A mapping from names."""

    kinds = frozenset([_OBJECT])

    def __init__(self, each: Coder) -> None:
        self._each = each

    def encode(self, value: Any) -> Any:
        if not all(isinstance(name, str) for name in value):
            raise TypeError(f"not every key of {value!r} is a text")
        return {name: self._each.encode(each) for name, each in value.items()}

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is not dict:
            raise _refusal(path, "an object", data)
        return {name: self._each.decode(each, f"{path}.{name}") for name, each in data.items()}


class RecordCoder(Coder):
    """A dataclass by its fields; what it makes of them itself is left out."""

    kinds = frozenset([_OBJECT])

    def __init__(self, type_: Any) -> None:
        self.type = type_
        self._coders: Dict[str, Coder] = {}
        self._encoders: List[Tuple[str, Callable[[Any], Any]]] = []

    def fill(self, coders: Dict[str, Coder]) -> None:
        """The forms of its fields, which may hold the class itself."""
        self._coders = coders
        self._encoders = [(name, coder.encode) for name, coder in coders.items()]

    def encode(self, value: Any) -> Any:
        if type(value) is not self.type:
            raise TypeError(f"{value!r} is no {self.type.__name__}")
        return {name: encode(getattr(value, name)) for name, encode in self._encoders}

    def decode(self, data: Any, path: str) -> Any:
        if type(data) is not dict:
            raise _refusal(path, "an object", data)
        return self.make(data, path)

    def make(self, data: Dict[str, Any], path: str) -> Any:
        """The object of these fields; a field that has a default may be missing."""
        values = {}
        for name, each in data.items():
            coder = self._coders.get(name)
            if coder is None:
                raise Refused(f"{path}: {self.type.__name__} has no field {name!a}")
            values[name] = coder.decode(each, f"{path}.{name}")
        try:
            return self.type(**values)
        except (TypeError, ValueError, ShsaError) as error:
            raise Refused(f"{path} is no {self.type.__name__}: {error}") from error


class FamilyCoder(Coder):
    """Several dataclasses; an object tells its own."""

    kinds = frozenset([_OBJECT])

    def __init__(self, records: Iterable[RecordCoder]) -> None:
        self._of_type = {record.type: record for record in records}
        self._of_name = {type_.__name__: record for type_, record in self._of_type.items()}
        if len(self._of_name) < len(self._of_type):
            raise TypeError(f"two classes have one name among {', '.join(self._of_name)}")

    def encode(self, value: Any) -> Any:
        type_ = type(value)
        if type_ not in self._of_type:
            raise TypeError(f"{value!r} is none of {', '.join(self._of_name)}")
        data = {CLASS: type_.__name__}
        data.update(self._of_type[type_].encode(value))
        return data

    def decode(self, data: Any, path: str) -> Any:
        name = data.get(CLASS) if type(data) is dict else None
        if type(name) is not str or name not in self._of_name:
            allowed = ", ".join(self._of_name)
            raise Refused(f"{path}: there is no class {name!a}; there are {allowed}")
        fields = {key: value for key, value in data.items() if key != CLASS}
        return self._of_name[name].make(fields, path)


class ChoiceCoder(Coder):
    """A union whose members differ by the sort of their JSON values."""

    def __init__(self, members: Sequence[Coder]) -> None:
        self._of_kind: Dict[str, Coder] = {}
        for member in members:
            for kind in member.kinds:
                if self._of_kind.setdefault(kind, member) is not member:
                    raise TypeError(f"two members of a union are both a {kind} in JSON")
        self.kinds = frozenset(self._of_kind)
        self._optional = members[0] if len(members) == 2 and _NULL in members[1].kinds else None

    def encode(self, value: Any) -> Any:
        if value is None and _NULL in self.kinds:
            return None
        member = self._optional or self._of_kind.get(kind_of(value))
        if member is None:
            raise TypeError(f"{value!r} is none of the union")
        return member.encode(value)

    def decode(self, data: Any, path: str) -> Any:
        coder = self._of_kind.get(kind_of(data))
        if coder is None:
            allowed = (
                "an object" if kind == _OBJECT else f"a {kind}" for kind in sorted(self.kinds)
            )
            raise _refusal(path, " or ".join(allowed), data)
        return coder.decode(data, path)


class FormedCoder(Coder):
    """A class that is no dataclass, or a protocol."""

    def __init__(self, type_: type, form: Form, inner: Coder) -> None:
        self._type, self._form, self._inner = type_, form, inner
        self._protocol = getattr(type_, "_is_protocol", False)
        self.kinds = inner.kinds

    def encode(self, value: Any) -> Any:
        if type(value) is not self._type and not self._protocol:
            raise TypeError(f"{value!r} is no {self._type.__name__}")
        return self._inner.encode(self._form.take(value))

    def decode(self, data: Any, path: str) -> Any:
        inner = self._inner.decode(data, path)
        try:
            return self._form.make(inner)
        except ShsaError as error:
            raise Refused(f"{path} is no {self._type.__name__}: {error}") from error


def kind_of(value: Any) -> str:
    """The sort of JSON value that a value is, or becomes."""
    if isinstance(value, enum.Enum):
        value = value.value
    if value is None:
        return _NULL
    if isinstance(value, bool):
        return _FLAG
    if isinstance(value, (int, float)):
        return _NUMBER
    if isinstance(value, str):
        return _TEXT
    return _LIST if isinstance(value, (tuple, list)) else _OBJECT


def _refusal(path: str, wanted: str, data: Any) -> Refused:
    seen = repr(data)
    return Refused(f"{path} must be {wanted}, not {seen if len(seen) <= 60 else seen[:57] + '...'}")

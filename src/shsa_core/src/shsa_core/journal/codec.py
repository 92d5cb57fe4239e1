"""Values as JSON and back without loss, as their types say; nothing else is read or run."""
import base64
import collections.abc
import dataclasses
import enum
from math import inf, isfinite, nan
from typing import Any, Callable, Dict, FrozenSet, Iterable, List, Mapping, NamedTuple, Optional
from typing import Sequence, Set, Tuple, Type, Union, get_args, get_origin, get_type_hints

from shsa_core.errors import ModelError, ShsaError

CLASS = "class"
"""The key of an object's class, where several are possible; no field can have this name."""
_NULL, _FLAG, _NUMBER, _TEXT, _LIST, _OBJECT = "null", "flag", "number", "text", "list", "object"
_ENDLESS = {"inf": inf, "-inf": -inf, "nan": nan}


class Form(NamedTuple):
    """The form of a class that is no dataclass, or that must be checked when it is read.

    It is written as the value of type `hint` that `take` makes of it, and `make` reverses that.
    """

    hint: Any
    take: Callable[[Any], Any]
    make: Callable[[Any], Any]


class Codec:
    """The JSON form of a dataclass, or of a union of them, with all that their fields hold.

    `forms` are those of other classes. Raises TypeError for a type that has no such form.
    """

    def __init__(self, hint: Any, forms: Optional[Mapping[type, Form]] = None) -> None:
        compiler = _Compiler(forms or {})
        alone = _is_record(hint) and hint not in compiler.forms
        self._coder = compiler.family([hint]) if alone else compiler.coder(hint)

    def encode(self, value: Any) -> Any:
        """Return the value as what `json` writes. Raises TypeError if it is not of the type."""
        return self._coder.encode(value)

    def decode(self, data: Any, where: str, what: str) -> Any:
        """Return the value of which `encode` made `data`. Raises ModelError if there is none.

        `what` is its name in errors, `where` the file and line.
        """
        try:
            return self._coder.decode(data, what)
        except _Refused as refused:
            raise ModelError(where, str(refused)) from refused


class _Refused(Exception):
    """Some data is not the form of the type."""


class _Coder(NamedTuple):
    """The functions that write and read one type; `kinds` are the sorts of its JSON values."""

    kinds: FrozenSet[str]
    encode: Callable[[Any], Any]
    decode: Callable[[Any, str], Any]


class _Compiler:
    """Makes the coders of types, each class once."""

    def __init__(self, forms: Mapping[type, Form]) -> None:
        self.forms = forms
        self._records: Dict[type, _Coder] = {}

    def coder(self, hint: Any) -> _Coder:
        """Return the coder of a type."""
        origin, arguments = get_origin(hint), get_args(hint)
        if hint in self.forms:
            return _formed(hint, self.forms[hint], self.coder(self.forms[hint].hint))
        if origin is Union:
            return self._union(arguments)
        if origin is tuple and arguments[-1] is not Ellipsis:
            return _fixed([self.coder(each) for each in arguments])
        if origin in (tuple, collections.abc.Sequence):
            return _many(self.coder(arguments[0]))
        if origin is frozenset and arguments[0] in (str, int):
            return _set(self.coder(arguments[0]))
        if origin is collections.abc.Mapping and arguments[0] is str:
            return _named(self.coder(arguments[1]))
        if hint in _PLAIN:
            return _PLAIN[hint]
        if isinstance(hint, type) and issubclass(hint, enum.Enum):
            return _enum(hint)
        if _is_record(hint):
            return self.family([hint]) if hint.__subclasses__() else self._record(hint)
        raise TypeError(f"a journal has no form for {hint}")

    def family(self, types: Iterable[type]) -> _Coder:
        """Return the coder of some dataclasses and all derived ones; an object tells its class."""
        classes = [each for type_ in types for each in _descent(type_)]
        of_name = {each.__name__: self._record(each) for each in classes}
        if len(of_name) < len(classes):
            raise TypeError(f"two classes have one name among {', '.join(of_name)}")
        of_type = {each: (each.__name__, of_name[each.__name__].encode) for each in classes}

        def encode(value: Any) -> Any:
            if type(value) not in of_type:
                raise TypeError(f"{value!r} is none of {', '.join(of_name)}")
            name, encode_fields = of_type[type(value)]
            return {CLASS: name, **encode_fields(value)}

        def decode(data: Any, path: str) -> Any:
            name = data.get(CLASS) if type(data) is dict else None
            if type(name) is not str or name not in of_name:
                allowed = ", ".join(of_name)
                raise _Refused(f"{path}: there is no class {name!a}; there are {allowed}")
            return of_name[name].decode({k: v for k, v in data.items() if k != CLASS}, path)

        return _Coder(frozenset([_OBJECT]), encode, decode)

    def _union(self, types: Sequence[Any]) -> _Coder:
        if float in types:
            types = [each for each in types if each is not int]
        records = [each for each in types if _is_record(each) and each not in self.forms]
        members = [self.coder(each) for each in types if each not in records]
        if records:
            members.append(self.family(records) if len(records) > 1 else self.coder(records[0]))
        return members[0] if len(members) == 1 else _choice(members)

    def _record(self, type_: Any) -> _Coder:
        """Return the coder of a dataclass by the fields of its constructor."""
        if type_ in self._records:
            return self._records[type_]
        coders: Dict[str, _Coder] = {}
        encoders: List[Tuple[str, Callable[[Any], Any]]] = []

        def encode(value: Any) -> Any:
            if type(value) is not type_:
                raise TypeError(f"{value!r} is no {type_.__name__}")
            return {name: encode_field(getattr(value, name)) for name, encode_field in encoders}

        def decode(data: Any, path: str) -> Any:
            _expect(dict, data, path, "an object")
            values = {}
            for name, each in data.items():
                if name not in coders:
                    raise _Refused(f"{path}: {type_.__name__} has no field {name!a}")
                values[name] = coders[name].decode(each, f"{path}.{name}")
            return _made(type_, lambda: type_(**values), path)

        coder = self._records[type_] = _Coder(frozenset([_OBJECT]), encode, decode)
        hints = get_type_hints(type_)
        try:  # a field may hold the class itself
            for field in dataclasses.fields(type_):
                if field.init:
                    coders[field.name] = self.coder(hints[field.name])
        except TypeError as error:
            raise TypeError(f"{type_.__name__}: {error}") from error
        encoders.extend((name, each.encode) for name, each in coders.items())
        return coder


def _is_record(hint: Any) -> bool:
    return isinstance(hint, type) and dataclasses.is_dataclass(hint)


def _descent(type_: Any) -> List[type]:
    return [type_, *(each for child in type_.__subclasses__() for each in _descent(child))]


def _made(type_: type, make: Callable[[], Any], path: str) -> Any:
    try:
        return make()
    except (TypeError, ValueError, ShsaError) as error:
        raise _Refused(f"{path} is no {type_.__name__}: {error}") from error


def _formed(type_: type, form: Form, inner: _Coder) -> _Coder:
    def encode(value: Any) -> Any:
        return inner.encode(form.take(_checked(type_, value)))

    def decode(data: Any, path: str) -> Any:
        value = inner.decode(data, path)
        return _made(type_, lambda: form.make(value), path)

    return _Coder(inner.kinds, encode, decode)


def _plain(type_: type, kind: str) -> _Coder:
    def encode(value: Any) -> Any:
        if not isinstance(value, type_) or type(value) is bool is not type_:
            raise TypeError(f"{value!r} is no {type_.__name__}")
        return value

    def decode(data: Any, path: str) -> Any:
        return _expect(type_, data, path, f"a value of the type {type_.__name__}")

    return _Coder(frozenset([kind]), encode, decode)


def _encode_float(value: Any) -> Any:
    if type(value) is not float:
        if not isinstance(value, (int, float)) or type(value) is bool:
            raise TypeError(f"{value!r} is no number")
        value = float(value) if isinstance(value, float) else int(value)
    return value if isfinite(value) else repr(value)


def _decode_float(data: Any, path: str) -> Any:
    if type(data) is str and data in _ENDLESS:
        return _ENDLESS[data]
    if type(data) not in (int, float):
        raise _refusal(path, "a number", data)
    return data


def _encode_bytes(value: Any) -> Any:
    return base64.b64encode(_checked(bytes, value)).decode("ascii")


def _decode_bytes(data: Any, path: str) -> Any:
    text = _expect(str, data, path, "bytes in base 64")
    try:
        return base64.b64decode(text, validate=True)
    except ValueError as error:
        raise _refusal(path, "bytes in base 64", data) from error


_PLAIN: Mapping[Any, _Coder] = {
    type(None): _plain(type(None), _NULL),
    bool: _plain(bool, _FLAG),
    int: _plain(int, _NUMBER),
    str: _plain(str, _TEXT),
    float: _Coder(frozenset([_NUMBER, _TEXT]), _encode_float, _decode_float),
    bytes: _Coder(frozenset([_TEXT]), _encode_bytes, _decode_bytes),
}


def _enum(type_: Any) -> _Coder:
    members = {member.value: member for member in type_}

    def encode(value: Any) -> Any:
        return type_(value).value if type(value) is not type_ else value.value

    def decode(data: Any, path: str) -> Any:
        if type(data) not in (str, int) or data not in members:
            raise _refusal(path, f"one of {', '.join(map(str, members))}", data)
        return members[data]

    return _Coder(frozenset(map(_kind_of, members)), encode, decode)


def _many(each: _Coder) -> _Coder:
    def encode(value: Any) -> Any:
        return [each.encode(item) for item in _checked((tuple, list), value)]

    def decode(data: Any, path: str) -> Any:
        items = enumerate(_expect(list, data, path, "a list"))
        return tuple([each.decode(item, f"{path}[{n}]") for n, item in items])

    return _Coder(frozenset([_LIST]), encode, decode)


def _set(each: _Coder) -> _Coder:
    many = _many(each)

    def encode(value: Any) -> Any:  # in order, so that equal sets are equal text
        return sorted(many.encode(list(_checked((frozenset, set), value))))

    return _Coder(many.kinds, encode, lambda data, path: frozenset(many.decode(data, path)))


def _fixed(places: Sequence[_Coder]) -> _Coder:
    def encode(value: Any) -> Any:
        if len(_checked((tuple, list), value)) != len(places):
            raise TypeError(f"{value!r} is no sequence of {len(places)}")
        return [place.encode(each) for place, each in zip(places, value)]

    def decode(data: Any, path: str) -> Any:
        if type(data) is not list or len(data) != len(places):
            raise _refusal(path, f"a list of {len(places)}", data)
        pairs = enumerate(zip(places, data))
        return tuple(place.decode(each, f"{path}[{n}]") for n, (place, each) in pairs)

    return _Coder(frozenset([_LIST]), encode, decode)


def _named(each: _Coder) -> _Coder:
    def encode(value: Any) -> Any:
        return {_checked(str, name): each.encode(item) for name, item in value.items()}

    def decode(data: Any, path: str) -> Any:
        items = _expect(dict, data, path, "an object").items()
        return {name: each.decode(item, f"{path}.{name}") for name, item in items}

    return _Coder(frozenset([_OBJECT]), encode, decode)


def _choice(members: Sequence[_Coder]) -> _Coder:
    """Return the coder of a union whose members differ by the sort of their JSON values."""
    of_kind: Dict[str, _Coder] = {}
    for member in members:
        for kind in member.kinds:
            if of_kind.setdefault(kind, member) is not member:
                raise TypeError(f"two members of a union are both a {kind} in JSON")
    others: Set[_Coder] = {each for kind, each in of_kind.items() if kind != _NULL}
    only = others.pop() if _NULL in of_kind and len(others) == 1 else None

    def encode(value: Any) -> Any:
        if value is None and _NULL in of_kind:
            return None
        member = only or of_kind.get(_kind_of(value))
        if member is None:
            raise TypeError(f"{value!r} is none of the union")
        return member.encode(value)

    def decode(data: Any, path: str) -> Any:
        member = of_kind.get(_kind_of(data))
        if member is None:
            allowed = ["an object" if k == _OBJECT else f"a {k}" for k in sorted(of_kind)]
            raise _refusal(path, " or ".join(allowed), data)
        return member.decode(data, path)

    return _Coder(frozenset(of_kind), encode, decode)


def _kind_of(value: Any) -> str:
    """Return the sort of JSON value that a value is, or becomes."""
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


def _checked(types: Union[Type[Any], Tuple[Type[Any], ...]], value: Any) -> Any:
    if not isinstance(value, types):
        raise TypeError(f"{value!r} is no {getattr(types, '__name__', 'sequence or set')}")
    return value


def _expect(type_: type, data: Any, path: str, wanted: str) -> Any:
    if type(data) is not type_:
        raise _refusal(path, wanted, data)
    return data


def _refusal(path: str, wanted: str, data: Any) -> _Refused:
    seen = repr(data)
    return _Refused(
        f"{path} must be {wanted}, not {seen if len(seen) <= 60 else seen[:57] + '...'}"
    )

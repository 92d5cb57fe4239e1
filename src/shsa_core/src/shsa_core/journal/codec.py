"""Values as JSON and back without loss, as their types say.

Nothing else is read, and nothing is run.
"""
import collections.abc
import dataclasses
import enum
from typing import (
    Any,
    Dict,
    Iterable,
    List,
    Mapping,
    Optional,
    Sequence,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from shsa_core.errors import ModelError
from shsa_core.journal.coders import (
    BytesCoder,
    ChoiceCoder,
    Coder,
    EnumCoder,
    FamilyCoder,
    FixedCoder,
    FloatCoder,
    Form,
    FormedCoder,
    ManyCoder,
    NamedCoder,
    PlainCoder,
    RecordCoder,
    Refused,
    SetCoder,
)


class Codec:
    """The JSON form of a type: a dataclass or a union of them.

    They are made of dataclasses, enums, tuples and plain values.

    Raises TypeError for a type that has no such form. `forms` are those of classes that are no
    dataclasses.
    """

    def __init__(self, hint: Any, forms: Optional[Mapping[type, Form]] = None) -> None:
        compiler = _Compiler(forms or {})
        self._coder = compiler.family((hint,)) if _is_record(hint) else compiler.coder(hint)

    def encode(self, value: Any) -> Any:
        """The value as what `json` writes. Raises TypeError if it is not of the type."""
        return self._coder.encode(value)

    def decode(self, data: Any, where: str, what: str) -> Any:
        """The value that `encode` made `data` of.

        `what` is its name in errors, `where` the file and line.

        Raises ModelError if it could not have.
        """
        try:
            return self._coder.decode(data, what)
        except Refused as refused:
            raise ModelError(where, str(refused)) from refused


class _Compiler:
    """Makes the coders of types, each class once."""

    def __init__(self, forms: Mapping[type, Form]) -> None:
        self._forms = forms
        self._records: Dict[type, RecordCoder] = {}

    def coder(self, hint: Any) -> Coder:
        """The coder of a type."""
        origin, arguments = get_origin(hint), get_args(hint)
        if hint in self._forms:
            form = self._forms[hint]
            return FormedCoder(hint, form, self.coder(form.hint))
        if origin is Union:
            return self._union(arguments)
        if origin is tuple and arguments[-1] is not Ellipsis:
            return FixedCoder([self.coder(each) for each in arguments])
        if origin in (tuple, collections.abc.Sequence):
            return ManyCoder(self.coder(arguments[0]))
        if origin is frozenset and arguments[0] in (str, int):
            return SetCoder(self.coder(arguments[0]))
        if origin is collections.abc.Mapping and arguments[0] is str:
            return NamedCoder(self.coder(arguments[1]))
        if hint is float:
            return FloatCoder()
        if hint is bytes:
            return BytesCoder()
        if hint in (bool, int, str, type(None)):
            return PlainCoder(hint)
        if isinstance(hint, type) and issubclass(hint, enum.Enum):
            return EnumCoder(hint)
        if _is_record(hint):
            return self.family((hint,)) if hint.__subclasses__() else self._record(hint)
        raise TypeError(f"a journal has no form for {hint}")

    def family(self, types: Iterable[type]) -> FamilyCoder:
        """The coder of some dataclasses and all that derive from them."""
        return FamilyCoder([self._record(each) for type_ in types for each in _descent(type_)])

    def _union(self, types: Sequence[Any]) -> Coder:
        if float in types:
            types = [each for each in types if each is not int]
        records = [each for each in types if _is_record(each) and each not in self._forms]
        others = [self.coder(each) for each in types if each not in records]
        if len(records) > 1:
            others.append(self.family(records))
        elif records:
            others.append(self.coder(records[0]))
        return others[0] if len(others) == 1 else ChoiceCoder(others)

    def _record(self, type_: Any) -> RecordCoder:
        if type_ not in self._records:
            record = self._records[type_] = RecordCoder(type_)
            hints = get_type_hints(type_)
            names = [each.name for each in dataclasses.fields(type_) if each.init]
            try:
                record.fill({name: self.coder(hints[name]) for name in names})
            except TypeError as error:
                raise TypeError(f"{type_.__name__}: {error}") from error
        return self._records[type_]


def _is_record(hint: Any) -> bool:
    return isinstance(hint, type) and dataclasses.is_dataclass(hint)


def _descent(type_: Any) -> List[type]:
    return [type_, *(each for child in type_.__subclasses__() for each in _descent(child))]

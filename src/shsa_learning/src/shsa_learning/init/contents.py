"""The numbers in a message type, each as a field that a SOM can name."""
from dataclasses import dataclass
from typing import List, Mapping, Optional, Sequence, Tuple

from shsa_core.errors import ShsaError
from shsa_core.model.field import ANGLES, is_distance, parse_field
from shsa_core.model.field_type import FLOATS, WHOLE, Layout
from shsa_learning.init.meanings import MEANINGS, NOTHING, Meaning, meaning

MOST_NUMBERS = 200
"""Of one publisher: what has more is a table, and no handful of values."""
MOST_ELEMENTS = 8
"""Of an array whose elements have no names."""
MOST_DEPTH = 10
_QUATERNION = {"x", "y", "z", "w"}
_BLOBS = ("uint8", "char", "byte", "int8")
_SKIPPED = (
    "std_msgs/Header",
    "std_msgs/MultiArrayLayout",
    "string",
    "time",
    "duration",
    "bool[]",
    "string[]",
)

_WRAPPERS = ("twist", "pose", "accel", "wrench", "transform", "point", "vector", "position")
"""Fields of messages that hold another one, and whose name the parts of it say again."""

Chain = Tuple[Tuple[str, str], ...]


@dataclass(frozen=True)
class Number:
    """A number in messages: its `field` as in a SOM, its type in the message, what it means.

    `words`: what it is called, without the wrappers around it.
    """

    field: str
    kind: str
    meaning: Meaning
    words: Tuple[str, ...]


@dataclass(frozen=True)
class Array:
    """An array of numbers; `size`: None if it may differ; `names`: the array of its names."""

    path: str
    kind: str
    size: Optional[int]
    names: str
    meaning: Meaning
    words: Tuple[str, ...]


@dataclass(frozen=True)
class LeftOut:
    """A part of a message that no field of a SOM can name, or that is no value, and why."""

    path: str
    why: str


@dataclass(frozen=True)
class Contents:
    """The numbers and arrays of a message type, and what is left out."""

    numbers: Tuple[Number, ...]
    arrays: Tuple[Array, ...]
    left_out: Tuple[LeftOut, ...]


def contents(message_type: str, layout: Layout) -> Contents:
    """Return the contents of a message type. Raises ShsaError if a type in it is not known here."""
    walk = _Walk(message_type, layout)
    walk.message(message_type, "", (), ())
    return Contents(tuple(walk.numbers), tuple(walk.arrays), tuple(walk.left_out))


def elements(
    array: Array, length: int, names: Sequence[str] = ()
) -> Tuple[List[Number], List[LeftOut]]:
    """Return the elements of an array of `length` as numbers, by their names if they have any.

    And those that no field can name.
    """
    numbers: List[Number] = []
    if not array.names:
        if length > MOST_ELEMENTS:
            why = f"an array of {length} numbers: name those that are used, {array.path}[0]"
            return [], [LeftOut(array.path, why)]
        for place in range(length):
            words = (*array.words, str(place))
            numbers.append(Number(f"{array.path}[{place}]", array.kind, array.meaning, words))
        return numbers, []
    left_out: List[LeftOut] = []
    if len(set(names)) < len(names) or len(names) > MOST_NUMBERS:
        return [], [LeftOut(array.path, "its names are not unique, or too many")]
    for name in names[:length]:
        field = f"{array.path}[{array.names}={name}]"
        try:
            parse_field(field)
        except ShsaError:
            left_out.append(LeftOut(field, "that name cannot be part of a field"))
            continue
        # A joint's name says more than that it is a joint's: left_wheel_velocity.
        numbers.append(Number(field, array.kind, array.meaning, (name, *array.words)))
    return numbers, left_out


class _Walk:
    """Goes through a message type."""

    def __init__(self, message_type: str, layout: Layout) -> None:
        self._type, self._layout, self._full = message_type, layout, False
        self.numbers: List[Number] = []
        self.arrays: List[Array] = []
        self.left_out: List[LeftOut] = []

    def message(self, kind: str, path: str, chain: Chain, words: Tuple[str, ...]) -> None:
        """Go through the message of type `kind` at `path`."""
        fields = self._layout(kind)
        found = meaning(chain)
        if path and set(fields) == _QUATERNION:
            for angle in ANGLES:
                self._add(Number(f"{angle}({path})", "float64", found, (*words[:-1], angle)))
            return
        names = next((name for name, each in fields.items() if each == "string[]"), "")
        for name, each in fields.items():
            at = f"{path}.{name}" if path else name
            within = (*chain, (kind, name))
            called = _called(words, kind, name, fields)
            element, bracket, size = each.partition("[")
            if element in _SKIPPED or each in _SKIPPED or name.endswith("covariance"):
                continue
            if not bracket and "/" not in element:
                self._add(Number(at, element, meaning(within), called))
            elif not bracket and at.count(".") < MOST_DEPTH:
                self.message(element, at, within, called)
            elif "/" in element:
                self.left_out.append(LeftOut(at, f"an array of {element}: its length may differ"))
            elif element in _BLOBS:
                self.left_out.append(LeftOut(at, "an array of bytes"))
            elif element in FLOATS or element in WHOLE:
                count = int(size[:-1]) if size[:-1] else None
                self._array(Array(at, element, count, names, meaning(within), called))

    def _array(self, array: Array) -> None:
        if is_distance(self._type, array.path):
            nearest = ("nearest", *array.words)
            self._add(Number(f"min({array.path})", array.kind, array.meaning, nearest))
        else:
            self.arrays.append(array)

    def _add(self, number: Number) -> None:
        if number.kind not in FLOATS and number.kind not in WHOLE:
            return
        if len(self.numbers) < MOST_NUMBERS:
            self.numbers.append(number)
        elif not self._full:
            self._full = True
            self.left_out.append(LeftOut(number.field, f"more than {MOST_NUMBERS} numbers"))


def _called(
    words: Tuple[str, ...], kind: str, name: str, fields: Mapping[str, str]
) -> Tuple[str, ...]:
    """Return the words by which a field of a message of type `kind` is called.

    Wrappers, as `twist.twist`, say nothing, and neither does `data` alone.
    """
    own = MEANINGS.get(kind, {}).get(name, NOTHING)
    if own.words:
        return (*words, own.words)
    wraps = "/" in fields[name] and "[" not in fields[name] and name in _WRAPPERS
    alone = name == "data" and set(fields) <= {"header", "layout", "data"}
    return words if wraps or alone else (*words, name)

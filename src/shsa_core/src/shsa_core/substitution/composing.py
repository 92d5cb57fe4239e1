"""Composes a substitute's messages: what it does not compute, as consumers accept it."""
import math
import re
from functools import reduce
from typing import Any, Dict, Iterator, Mapping, Optional, Tuple

from shsa_core.model.field_type import FLOATS
from shsa_core.model.kinds import Others
from shsa_core.model.conventions import CONVENTIONS, GENERIC, Convention, Covariance, Mark

HEADER, QUATERNION = "std_msgs/Header", "geometry_msgs/Quaternion"
_INDEX = re.compile(r"\[[^\]]*\]")
_ANGLE = re.compile(r"(roll|pitch|yaw)\((.*)\)\Z")

Written = Mapping[str, Optional[float]]
"""The fields that are computed, each with its standard deviation; None: not known."""


def compose(message_class: Any, last: Optional[Any], others: Others, written: Written) -> Any:
    """Return a message in which all stands but the values of the fields `written`, and the stamp.

    It is made of `last`, which it takes. Every quaternion in it is of unit length. Its arrays are
    lists, so that they can be written.
    """
    message = message_class() if last is None else last
    _unlock(message)
    if others is not Others.LAST or last is None:
        _Marking(others, _plain(written), last is not None).mark(message, "", None)
    for quaternion in quaternions(message):
        normalize(quaternion)
    return message


def quaternions(message: Any) -> Iterator[Any]:
    """Every quaternion in a message."""
    if message._type == QUATERNION:
        yield message
    for _, value in _messages(message):
        yield from quaternions(value)


def normalize(quaternion: Any) -> None:
    """Make a quaternion one of unit length; one that has no direction becomes the identity."""
    q = quaternion
    length = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not 1e-6 < length < math.inf:
        q.x, q.y, q.z, q.w = 0.0, 0.0, 0.0, 1.0
    else:
        q.x, q.y, q.z, q.w = q.x / length, q.y / length, q.z / length, q.w / length


class _Marking:
    """Marks what is not known in a message, type by type."""

    def __init__(self, others: Others, written: Dict[str, Optional[float]], has_last: bool) -> None:
        self._others = others
        self._written = written
        self._has_last = has_last

    def mark(self, message: Any, path: str, forced: Optional[Mark]) -> None:
        """Mark the fields of a message at `path`; `forced`: by whom it is in."""
        convention = CONVENTIONS.get(message._type, GENERIC)
        matrices = [covariance.field for covariance in convention.covariances]
        for name, value in _messages(message):
            mark = forced or convention.fields.get(name)
            self.mark(value, _join(path, name), mark)
        for name, kind in zip(message.__slots__, message._slot_types):
            marked = kind.split("[")[0] in FLOATS or "/" not in kind and name in convention.fields
            if marked and name not in matrices:
                mark = forced or convention.fields.get(name) or convention.rest
                known = _join(path, name) in self._written
                setattr(message, name, self._marked(getattr(message, name), mark, known))
        for covariance in convention.covariances:
            self._fill(message, path, covariance)
        self._raise_flags(message, path, convention)

    def _marked(self, value: Any, mark: Mark, known: bool) -> Any:
        """Return a float or a list of them, as it stands where it is not computed."""
        if isinstance(value, list):
            empty = mark is Mark.EMPTY and not known and self._others is Others.UNKNOWN
            return [] if empty else [self._marked(each, mark, known) for each in value]
        if mark is Mark.ZERO or (self._others is Others.ZERO and mark is not Mark.SETTING):
            return type(value)()
        if mark is Mark.HELD:
            return value if math.isfinite(value) else 0.0
        held = self._has_last and mark in (Mark.SETTING, Mark.HELD_OR_NAN)
        return value if held else math.nan

    def _fill(self, message: Any, path: str, covariance: Covariance) -> None:
        """Write the variances of what is computed, where known; of the rest, that it is not."""
        given = any(_within(each, _join(path, covariance.group)) for each in self._written)
        size = len(covariance.rows)
        entries = [0.0] * (size * size)
        if not given and covariance.absent is not None:
            entries[0] = covariance.absent
        else:
            for row, name in enumerate(covariance.rows):
                error = self._written.get(_join(path, name)) if name else None
                entries[row * size + row] = covariance.unknown if error is None else error**2
        fixed = isinstance(getattr(message, covariance.field), list)
        setattr(message, covariance.field, entries if fixed else entries[0])

    def _raise_flags(self, message: Any, path: str, convention: Convention) -> None:
        for flag in convention.flags:
            if flag.unless and all(_join(path, name) in self._written for name in flag.unless):
                continue
            *owners, last = flag.field.split(".")
            setattr(reduce(getattr, owners, message), last, flag.value)


def _unlock(message: Any) -> None:
    """Make lists of the tuples and bytes that arrays are when they were read."""
    for _, value in _messages(message):
        _unlock(value)
    for name, kind in zip(message.__slots__, message._slot_types):
        if "[" in kind and "/" not in kind:
            setattr(message, name, list(getattr(message, name)))


def _messages(message: Any) -> Iterator[Tuple[str, Any]]:
    """Return the messages in a message, but for headers: the field, and each message in it."""
    for name, kind in zip(message.__slots__, message._slot_types):
        if "/" in kind and kind != HEADER:
            value = getattr(message, name)
            for each in value if isinstance(value, (list, tuple)) else (value,):
                yield name, each


def _plain(written: Written) -> Dict[str, Optional[float]]:
    """Fields without the places of arrays, and angles as if they were parts of the quaternion."""
    return {_INDEX.sub("", _ANGLE.sub(r"\2.\1", field)): error for field, error in written.items()}


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path and name else path or name


def _within(path: str, group: str) -> bool:
    return not group or path == group or path.startswith(group + ".")

"""The form of messages, from their bytes: the frames that they name, and how long their arrays are."""
import re
import struct
from functools import lru_cache
from typing import Iterator, List, NamedTuple, Optional, Tuple

from shsa_core import message_types
from shsa_core.model.samples import Part
from shsa_core.ros.rospy_patches.subscribing import LENGTH

FORM_END = 256
"""So many first bytes are looked at of a message that nobody else wants to see."""
MOST_ELEMENTS = 100
"""What lies behind a longer array of what varies in size is not looked at."""
FRAMES = ("frame_id", "child_frame_id")
_ARRAY = re.compile(r"\[(\d*)\]$")
_BITS = re.compile(r"(?:u?int|float)(\d+)$")


class _Step(NamedTuple):
    """A part of a message: `size` bytes, or a `counted` number of times as many, or `inner` parts.

    `name` of a part that is told; `frame`: it is a text.
    """

    size: int
    counted: bool = False
    name: str = ""
    frame: bool = False
    inner: Tuple["_Step", ...] = ()


class FormReader:
    """Reads the form of messages of the type `kind`. Raises ShsaError if it is not built here."""

    def __init__(self, kind: str) -> None:
        steps = list(_steps(kind, ""))
        while steps and not steps[-1].name:
            steps.pop()
        self._steps = tuple(steps)

    def __call__(self, data: bytes) -> Tuple[Tuple[str, Part], ...]:
        """Return the parts by name, as far as the bytes go."""
        found: List[Tuple[str, Part]] = []
        try:
            _walk(self._steps, data, 0, found)
        except (struct.error, UnicodeDecodeError, OverflowError):
            pass  # it was cut, or is no such message
        return tuple(found)


def _walk(
    steps: Tuple[_Step, ...], data: bytes, at: int, found: Optional[List[Tuple[str, Part]]]
) -> int:
    """Note the parts that begin at a place; return where they end."""
    for size, counted, name, frame, inner in steps:
        count = 1
        if counted:
            count = LENGTH.unpack_from(data, at)[0]
            at += LENGTH.size
        if name and found is not None:
            if frame and at + count > len(data):
                break
            found.append((name, data[at : at + count].decode() if frame else count))
        if inner and count > MOST_ELEMENTS:
            raise OverflowError
        at += count * size
        for _ in range(count if inner else 0):
            at = _walk(inner, data, at, None)
    return at


@lru_cache(maxsize=None)
def _steps(kind: str, prefix: str) -> Tuple[_Step, ...]:
    """Return the parts of a message type; what always has the same size is one with what follows."""
    found: List[_Step] = []
    for field, whole in message_types.layout(kind).items():
        array = _ARRAY.search(whole)
        element, name = whole[: array.start()] if array else whole, f"{prefix}{field}"
        inner = _of_one(element, name, field)
        if array and not array.group(1):
            fixed = all(not each.counted for each in inner)
            size = sum(each.size for each in inner) if fixed else 0
            found.append(_Step(size, True, name, inner=() if fixed else inner))
        elif array:
            found += inner * int(array.group(1))
        else:
            found += inner
    return tuple(_joined(found))


def _joined(steps: List[_Step]) -> Iterator[_Step]:
    fixed = 0
    for step in steps:
        fixed += 0 if step.counted else step.size
        if step.counted:
            yield from [_Step(fixed)] if fixed else []
            yield step
            fixed = 0
    yield from [_Step(fixed)] if fixed else []


def _of_one(kind: str, name: str, field: str) -> Tuple[_Step, ...]:
    """Return the parts of one value of a type."""
    if "/" in kind:
        return _steps(kind, f"{name}.")
    if kind == "string":
        frame = field in FRAMES
        return (_Step(1, True, name if frame else "", frame),)
    bits = _BITS.match(kind)
    return (_Step(int(bits.group(1)) // 8 if bits else 8 if kind in ("time", "duration") else 1),)

"""Fields of messages: found by their text, read and written as numbers.

Messages come as bytes, and are decoded only where somebody wants to know a value.
"""
import dataclasses
import functools
import math
import struct
from operator import attrgetter
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Type

import genpy

from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.field import ANGLES, Named, Step, parse_field
from shsa_core.model.field_type import FLOATS, field_type
from shsa_core.model.field_value import angles, field_value, place_of, quaternion
from shsa_core.model.samples import Parts
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.ros.rospy_patches.subscribing import LENGTH
from shsa_core.text import shown

STAMP_END, HEADER_END = 12, 256
"""The stamp of a std_msgs/Header lies in so many first bytes, and all of it in so many."""
FRAMES = ("header.frame_id", "child_frame_id")


class Field:
    """One number in a message type, as `twist.twist.linear.x`; see shsa_core.model.field.

    `writable`: whether a value can be written to it. Raises ShsaError if the type has no such
    field, or if it is not a number.
    """

    def __init__(self, message_class: Type[genpy.Message], text: str) -> None:
        def layout(name: str) -> Mapping[str, str]:
            if name == message_class._type:
                return message_types.layout_of(message_class)
            return message_types.layout(name)

        self._parsed = parsed = parse_field(text)
        self._text = str(parsed)
        self._type = field_type(message_class._type, text, layout)
        self._steps, self._function = parsed.steps, parsed.function
        self.writable = self._type.writable

    def get(self, message: genpy.Message) -> Optional[float]:
        """Return the field's value; None if the message has none, as it does not name it.

        NaN where an array is shorter than the place, or where there is no number.
        """
        return field_value(message, self._parsed)

    def set(self, message: genpy.Message, value: float) -> None:
        """Write the field; a whole number is rounded to.

        What is named by its name and not there yet is added to the message. Raises ShsaError if the
        value does not fit, or if an array has no such element.
        """
        if not self.writable:
            raise ShsaError(f"{self._text} is read-only")
        owner: Any = message
        for step in self._steps[:-1]:
            owner = self._inner(owner, step)
        last = self._steps[-1]
        if self._function:
            self._turn(self._inner(owner, last), value)
            return
        plain = self._type.fit(value)
        if last.part is None:
            setattr(owner, last.name, plain)
        else:
            self._put(owner, last, plain)

    def _inner(self, owner: Any, step: Step) -> Any:
        """Return the message that a step leads to; it must be there."""
        found = getattr(owner, step.name)
        if step.part is None:
            return found
        place = place_of(owner, step.part)
        if place is None or place >= len(found):
            raise ShsaError(f"{self._text}: the message has no {step}, and no other one is known")
        return found[place]

    def _turn(self, rotation: Any, angle: float) -> None:
        """Set one angle of a rotation; the other two stay."""
        turned = [0.0 if math.isnan(each) else each for each in angles(*_components(rotation))]
        turned[ANGLES.index(self._function)] = angle
        for name, each in zip("xyzw", quaternion(*turned)):
            setattr(rotation, name, each)

    def _put(self, owner: Any, step: Step, value: float) -> None:
        """Set an element of an array; one that is named and not there is added, and its name."""
        place = place_of(owner, step.part)
        if place is None and isinstance(step.part, Named):
            place = _add_name(owner, step.part)
        array = list(getattr(owner, step.name))
        if isinstance(step.part, Named) and self._type.kind in FLOATS:
            # What is beside it in the array is not known; only such numbers can say so.
            array += [math.nan] * ((place or 0) - len(array))
        if place is None or place > len(array):
            raise ShsaError(
                f"{self._text}: the array has {len(array)} elements, and no message that has more "
                "is known"
            )
        array[place : place + 1] = [value]
        setattr(owner, step.name, array)


@functools.lru_cache(maxsize=None)
def problem(message_type: str, text: str, written: bool) -> str:
    """Why a field cannot be read, or written, on this computer; empty if it can.

    Whoever has asked once knows the answer at a takeover.
    """
    try:
        field = Field(message_types.message_class(message_type), text)
    except ShsaError as error:
        return str(error)
    return f"{text} is read-only" if written and not field.writable else ""


def _components(rotation: Any) -> Tuple[float, float, float, float]:
    return rotation.x, rotation.y, rotation.z, rotation.w


def _add_name(owner: Any, key: Named) -> int:
    """Add a name to its array; its place. What the arrays beside it have there is not known."""
    names = list(getattr(owner, key.names))
    for name, kind in message_types.layout_of(owner).items():
        array = getattr(owner, name)
        if not kind.endswith("[]") or name == key.names or not names or len(array) != len(names):
            continue
        if kind[:-2] not in FLOATS:
            raise ShsaError(f"{key.name} cannot be added: {name} has no mark for what is not known")
        setattr(owner, name, [*array, math.nan])
    setattr(owner, key.names, [*names, key.name])
    return len(names)


class Decoder:
    """Reads fields from the bytes of messages of the type `kind`.

    `header`: what the publisher says of its messages. `problems`: why some fields cannot be read;
    they have no value. Raises ShsaError if the publisher names another type, of which nothing is
    loaded, or if the type is not known here or is another version.
    """

    def __init__(self, kind: str, header: Mapping[str, str], fields: Sequence[str]) -> None:
        if header["type"] != kind:
            named = shown(header["type"], 100)
            raise ShsaError(f"the publisher says that they are {named}, and not {kind}")
        self._class = message_types.message_class(kind)
        self._message = self._class()  # to make a new one of each is half of what reading costs
        if header["md5sum"] != self._class._md5sum:
            raise ShsaError(
                f"{kind} is another version at the publisher: "
                f"its sum is {header['md5sum']}, here {self._class._md5sum}"
            )
        self._fields: List[Optional[Field]] = []
        self.problems: List[str] = []
        for field in fields:
            try:
                self._fields.append(Field(self._class, field))
            except ShsaError as error:
                self._fields.append(None)
                self.problems.append(str(error))
        self.has_stamp: bool = self._class._has_header
        layout = message_types.layout_of(self._class)
        self._arrays = [name for name, kind in layout.items() if kind.endswith("[]")]
        self._frames = FRAMES[not self.has_stamp : 1 + ("child_frame_id" in layout)]

    def form(self) -> Parts:
        """Return the frames in the message that was read last, and how long its arrays are."""
        frames = ((name, attrgetter(name)(self._message)) for name in self._frames)
        return (*frames, *((name, len(getattr(self._message, name))) for name in self._arrays))

    def values(self, data: bytes) -> Tuple[Optional[float], ...]:
        """Return the fields' values, None where there is none.

        Raises ShsaError if the bytes are not a message of the type.
        """
        message = self._message
        try:
            message.deserialize(data)
        except (genpy.DeserializationError, struct.error, UnicodeDecodeError) as error:
            raise ShsaError(f"the message is not a {self._class._type}: {error}") from error
        return tuple(None if field is None else field.get(message) for field in self._fields)


def stamp(data: bytes) -> int:
    """Return the time in the std_msgs/Header that a message begins with, in ns; 0: none."""
    if len(data) < STAMP_END:
        return 0
    seconds, nanoseconds = struct.unpack_from("<4xII", data)
    return int(seconds) * 10**9 + int(nanoseconds)


def frame(data: bytes) -> Parts:
    """Return the frame in the std_msgs/Header that a message begins with; nothing if it was cut."""
    begin = STAMP_END + LENGTH.size
    end = begin + LENGTH.unpack_from(data, STAMP_END)[0] if len(data) >= begin else math.inf
    return ((FRAMES[0], data[begin:end].decode(errors="replace")),) if end <= len(data) else ()


class Problem(NamedTuple):
    """Something that cannot be used; `needed`: it would have to be healed."""

    text: str
    needed: bool


def mark_unusable(som: Som) -> Tuple[Som, List[Problem]]:
    """Return the SOM with a mark at all that cannot be used here, and what that is.

    What is not marked is used and healed as ever.
    """
    problems: List[Problem] = []
    som = with_unknowns(som, message_types.layout)
    return som.with_services(_marked(service, problems) for service in som), problems


def _marked(service: Service, problems: List[Problem]) -> Service:
    provides: List[Provision] = []
    unwritable = ""
    for each in service.provides:
        unreadable = problem(service.type, each.field, False)
        unwritable = unwritable or problem(service.type, each.field, True)
        provides.append(dataclasses.replace(each, unreadable=unreadable))
        if unreadable:
            text = f"{service.name}: {each.property} is not read: {unreadable}"
            problems.append(Problem(text, needed=False))
    if service.needed and service.policy.plans and unwritable:
        text = f"{service.name} is needed, and cannot be substituted: {unwritable}"
        problems.append(Problem(text, needed=True))
    return dataclasses.replace(service, provides=tuple(provides), unwritable=unwritable)

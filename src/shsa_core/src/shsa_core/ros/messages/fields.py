"""Messages as bytes, decoded only where somebody wants to know a value."""
import io
import math
import re
import struct
from operator import attrgetter
from typing import List, Mapping, Optional, Sequence, Tuple, Type

import genpy

from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_core.model.field_value import Field
from shsa_core.model.samples import Parts
from shsa_core.ros.rospy_patches.subscribing import LENGTH
from shsa_core.text import shown

STAMP_END, HEADER_END = 12, 256
"""The stamp of a std_msgs/Header lies in so many first bytes, and all of it in so many."""
FRAMES = ("header.frame_id", "child_frame_id")


class Decoder:
    """Reads fields from the bytes of messages of the type `kind`.

    `header`: what the publisher says of its messages. `problems`: why some fields cannot be read;
    they have no value. Raises ShsaError if the publisher names another type or version, or if the
    type is not known here.
    """

    def __init__(self, kind: str, header: Mapping[str, str], fields: Sequence[str]) -> None:
        why = foreign(kind, header)
        if why:
            raise ShsaError(why)
        self._class = message_types.message_class(kind)
        self._message = self._class()  # to make a new one of each is half of what reading costs
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
        # What is counted may vary, and an array of messages has as many as there are to be seen.
        plain = (name for name, kind in layout.items() if re.fullmatch(r"\w+\[\]", kind))
        self._arrays = [name for name in plain if f"count({name})" not in fields]
        self._frames = FRAMES[not self.has_stamp : 1 + ("child_frame_id" in layout)]

    def form(self) -> Parts:
        """Return the frames in the message that was read last, and how long its arrays are."""
        frames = ((name, attrgetter(name)(self._message)) for name in self._frames)
        return (*frames, *((name, len(getattr(self._message, name))) for name in self._arrays))

    def values(self, data: bytes) -> Tuple[Optional[float], ...]:
        """Return the fields' values, None for none. Raises ShsaError if it is no message."""
        message = self._message
        try:
            message.deserialize(data)
        except (genpy.DeserializationError, struct.error, UnicodeDecodeError) as error:
            raise ShsaError(f"the message is not a {self._class._type}: {error}") from error
        return tuple(None if field is None else field.get(message) for field in self._fields)


def foreign(kind: str, header: Mapping[str, str]) -> str:
    """Return why messages of this header are no `kind`; ShsaError: that is not known here."""
    if header["type"] != kind:
        return f"the publisher says that they are {shown(header['type'], 100)}, and not {kind}"
    ours, its = message_types.message_class(kind)._md5sum, header["md5sum"]
    another = f"{kind} is another version at the publisher: its sum is {its}, here {ours}"
    return "" if its in (ours, "*") else another


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


def read_message(message_class: Type[genpy.Message], data: bytes) -> genpy.Message:
    """Return the message that was serialized. Raises ShsaError if it is not one and no more."""
    message = message_class()
    again = io.BytesIO()
    try:
        message.deserialize(data)
        message.serialize(again)
        rest = len(data) - again.tell()
        if rest:
            raise ValueError(f"{rest} are left over")
    except (genpy.MessageException, struct.error, ValueError, OverflowError) as error:
        raise ShsaError(f"{len(data)} bytes are no {message_class._type}: {error}") from error
    return message

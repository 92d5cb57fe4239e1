"""Messages as bytes: decoded only where somebody wants to know a value."""
import queue
import struct
from typing import List, Mapping, Optional, Sequence, Tuple

import genpy
import rospy

from shsa_core.errors import ShsaError
from shsa_core.message_types import message_class
from shsa_core.ros.messages.fields import Field
from shsa_core.text import shown


__all__ = ["Decoder", "message_class", "stamp"]

STAMP_END = 12
"""The stamp of a std_msgs/Header lies in so many first bytes."""


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
        self._class = message_class(kind)
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

    def values(self, data: bytes) -> Tuple[Optional[float], ...]:
        """The fields' values, None where there is none.

        Raises ShsaError if the bytes are not a message of the type.
        """
        message = self._message
        try:
            message.deserialize(data)
        except (genpy.DeserializationError, struct.error, UnicodeDecodeError) as error:
            raise ShsaError(f"the message is not a {self._class._type}: {error}") from error
        return tuple(None if field is None else field.get(message) for field in self._fields)


def one_message(topic: str, kind: str, publisher: str, seconds: float) -> bytes:
    """The next message of a publisher, serialized; empty if none comes in time."""
    heard: "queue.Queue[bytes]" = queue.Queue()

    def take(message: rospy.AnyMsg) -> None:
        header = message._connection_header
        if (header["callerid"], header["type"]) == (publisher, kind):
            heard.put(message._buff)

    subscriber = rospy.Subscriber(topic, rospy.AnyMsg, take, tcp_nodelay=True)
    try:
        return heard.get(timeout=seconds)
    except queue.Empty:
        return b""
    finally:
        subscriber.unregister()


def stamp(data: bytes) -> int:
    """The time in the std_msgs/Header that a message begins with, in ns; 0: it was not set."""
    if len(data) < STAMP_END:
        return 0
    seconds, nanoseconds = struct.unpack_from("<4xII", data)
    return int(seconds) * 10**9 + int(nanoseconds)

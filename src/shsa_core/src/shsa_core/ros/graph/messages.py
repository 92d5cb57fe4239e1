"""Messages as bytes: decoded only where somebody wants to know a value."""
import struct
from typing import Mapping, Optional, Sequence, Tuple, Type

import genpy
from genpy.message import get_message_class

from shsa_core.errors import ShsaError
from shsa_core.ros.graph.fields import Field


def message_class(name: str) -> Type[genpy.Message]:
    """The class of the message type `name`; raises ShsaError if it is not built here."""
    try:
        found = get_message_class(name)
    except (ImportError, ValueError) as error:
        raise ShsaError(f"message type {name} cannot be loaded: {error}") from error
    if found is None:
        raise ShsaError(f"message type {name} is not known here: build its package and source it")
    return found


class Decoder:
    """Reads fields from the bytes of messages of one type, as a connection header gives it.

    Raises ShsaError if the type is not known here or is another version, or if a field is not a
    number of it.
    """

    def __init__(self, header: Mapping[str, str], fields: Sequence[str]) -> None:
        self._class = message_class(header["type"])
        if header["md5sum"] != self._class._md5sum:
            raise ShsaError(
                f"{header['type']} is another version at the publisher: "
                f"its sum is {header['md5sum']}, here {self._class._md5sum}"
            )
        self._fields = [Field(self._class, field) for field in fields]
        self.has_stamp: bool = self._class._has_header

    def values(self, data: bytes) -> Tuple[float, ...]:
        """The fields' values; raises ShsaError if the bytes are not a message of the type."""
        message = self._class()
        try:
            message.deserialize(data)
        except (genpy.DeserializationError, struct.error, UnicodeDecodeError) as error:
            raise ShsaError(f"the message is not a {self._class._type}: {error}") from error
        return tuple(field.get(message) for field in self._fields)


def stamp(data: bytes) -> Optional[float]:
    """The time in s in the std_msgs/Header that a message begins with; None if it was not set."""
    if len(data) < 12:
        return None
    seconds, nanoseconds = struct.unpack_from("<4xII", data)
    return seconds + nanoseconds * 1e-9 if seconds or nanoseconds else None

"""Reads all numbers of messages, of which only the type is known, for a survey."""
import struct
from typing import Any, Dict, List, Mapping, Optional, Tuple

import genpy

from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_core.model.field_value import Field
from shsa_learning.init.contents import Array, Contents, LeftOut, Number, contents, elements
from shsa_learning.init.survey import Publisher, Refused, Surveyor, outside
from shsa_learning.recordings.bags import installed

MOST_SHAPES = 50
"""Sets of lengths and names that the arrays of one publisher may have."""

Shape = Tuple[Tuple[int, Tuple[str, ...]], ...]


class Reader:
    """Reads all numbers from the bytes of messages of the type `kind` whose sum is `md5sum`.

    Raises ShsaError if the type is not known here, or is another version.
    """

    def __init__(self, kind: str, md5sum: str = "") -> None:
        self.message_class: Any = installed(kind, md5sum)
        self.contents: Contents = contents(kind, message_types.layout)
        self._numbers = [(number, self._field(number)) for number in self.contents.numbers]
        self._shapes: Dict[Shape, List[Tuple[Number, Field]]] = {}

    def read(self, data: bytes) -> Tuple[Mapping[Number, Optional[float]], List[LeftOut]]:
        """Return the numbers in a message, and the parts that are none, as far as that is new.

        Raises ShsaError if the bytes are not a message of the type.
        """
        message = self.message_class()
        try:
            message.deserialize(data)
        except (genpy.DeserializationError, struct.error, UnicodeDecodeError) as error:
            raise ShsaError(f"its messages cannot be read: {error}") from error
        omitted: List[LeftOut] = []
        fields = self._numbers + self._elements(message, omitted)
        return {number: field.get(message) for number, field in fields}, omitted

    def _elements(self, message: Any, omitted: List[LeftOut]) -> List[Tuple[Number, Field]]:
        shape = tuple(_shape(message, array) for array in self.contents.arrays)
        found = self._shapes.get(shape)
        if found is not None or len(self._shapes) >= MOST_SHAPES:
            return found or []
        found = self._shapes[shape] = []
        for array, (length, names) in zip(self.contents.arrays, shape):
            numbers, others = elements(array, length, names)
            found += [(each, self._field(each)) for each in numbers]
            omitted += others
        return found

    def _field(self, number: Number) -> Field:
        return Field(self.message_class, number.field)


def _shape(message: Any, array: Array) -> Tuple[int, Tuple[str, ...]]:
    """Return the length of an array in a message, and the names of its elements."""
    owner: Any = message
    *path, last = array.path.split(".")
    for name in path:
        owner = getattr(owner, name)
    return len(getattr(owner, last)), tuple(getattr(owner, array.names)) if array.names else ()


class Values:
    """Reads messages for a surveyor: of each type once what it holds."""

    def __init__(self, surveyor: Surveyor) -> None:
        self._surveyor = surveyor
        self._readers: Dict[Tuple[str, str], Optional[Reader]] = {}
        self._why: Dict[Tuple[str, str], str] = {}

    def takes(self, publisher: Publisher, md5sum: str = "") -> Optional[Reader]:
        """Return the reader for a publisher, which is taken in; None if it is left out."""
        why = outside(*publisher)
        reader = None if why else self._reader(publisher.type, md5sum)
        if reader is None:
            why = why or self._why[publisher.type, md5sum]
            self._surveyor.refuse(Refused(*publisher, why))
        elif self._surveyor.knows(publisher):
            return reader
        return None

    def unheard(self, publisher: Publisher) -> None:
        """Take a publisher in of which nothing has come."""
        reader = None if self._surveyor.has(publisher) else self.takes(publisher)
        if reader is not None:
            self._surveyor.values(publisher, dict.fromkeys(reader.contents.numbers))
            for part in reader.contents.left_out:
                self._surveyor.omit(publisher, part)

    def read(self, publisher: Publisher, reader: Reader, size: int, data: Optional[bytes]) -> None:
        """Read what a message says, if that is wanted."""
        if not self._surveyor.wants(publisher, size) or data is None:
            return
        try:
            numbers, omitted = reader.read(data)
        except ShsaError as error:
            self._surveyor.refuse(Refused(*publisher, str(error)))
            return
        self._surveyor.values(publisher, numbers)
        for part in (*reader.contents.left_out, *omitted):
            self._surveyor.omit(publisher, part)

    def _reader(self, kind: str, md5sum: str) -> Optional[Reader]:
        key = kind, md5sum
        if key not in self._readers:
            self._readers[key] = None
            try:
                self._readers[key] = Reader(kind, md5sum)
            except ShsaError as error:
                self._why[key] = str(error)
        return self._readers[key]

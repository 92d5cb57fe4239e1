"""Reads a rosbag by a SOM: what the services said of their properties, and not what healing said.

Of a large bag some stretches are kept alone. Message types are those that are built here: rosbag
would make a module of the definitions that a bag brings along, and run it. Messages of substitutes
are left out, by the name of the publisher in the bag and by what healing recorded of itself.
"""
import contextlib
import math
import os
import resource
import struct
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence
from typing import Set, Tuple

import numpy as np
import psutil

from shsa_core import message_types
from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.regular import open_to_read
from shsa_core.model.names import PREFIX, full_name
from shsa_core.model.field import FieldText, parse_field
from shsa_core.model.field_type import field_type
from shsa_core.model.field_value import field_value
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.text import shown
from shsa_learning.recordings.recording import Recording, Series, ordered, times_of
from shsa_learning.recordings.reservoir import MOST_ROWS, NO_NUMBER, Reservoir

MAGIC = b"#ROSBAG V"
SUBSTITUTIONS, INCIDENTS = "/shsa/substitutions", "/shsa/incidents"
"""The ends of the names of healing's own topics, whatever namespace it ran in."""

CHUNK_ROWS = 1000
"""Messages that are handled together, and between two steps of the progress."""

Fields = Tuple[FieldText, ...]
Step = Callable[[int], object]


def is_bag(path: str) -> bool:
    """Return whether a file is a rosbag by what it begins with, or by its name."""
    with open_to_read(path) as file:
        return file.read(len(MAGIC)) == MAGIC or path.endswith(".bag")


def read_bag(
    path: str, som: Som, step: Step = lambda size: None, most: int = MOST_ROWS
) -> Recording:
    """Read a rosbag: a series for each value of each service of the SOM in it.

    `step` is told of the bytes that are read, as far as that is known; of the messages of a
    publisher `most` are kept. Raises ShsaError if it cannot be read, if a topic has another type
    than the SOM says, or if a type lacks a field.
    """
    with opened(path) as bag:
        return _Reader(path, bag, som, step, most).read()


@contextlib.contextmanager
def opened(path: str) -> Iterator[Any]:
    """Open a rosbag. Raises ModelError if it cannot be read, also while it is.

    It may take half of the memory that is free: few bytes of bz2 can stand for many.
    """
    open_to_read(path).close()  # rosbag would wait for a pipe
    import genpy  # ROS is loaded for a bag alone
    import rosbag

    def message_type(connection: Any) -> Any:
        try:
            return installed(connection.datatype, connection.md5sum)
        except ShsaError as error:
            raise rosbag.ROSBagException(str(error)) from error

    rosbag.bag._get_message_type = message_type
    try:
        with _limited_memory(), rosbag.Bag(path) as bag:
            yield bag
    except rosbag.ROSBagUnindexedException as error:
        what = "has no index, as its recording was cut off; `rosbag reindex` gives it one"
        raise ModelError(path, what) from error
    except (
        *(OSError, EOFError, KeyError, IndexError, TypeError, ValueError, AttributeError),
        *(MemoryError, rosbag.ROSBagException, struct.error, genpy.MessageException),
    ) as error:
        raise ModelError(path, f"cannot be read as a rosbag: {error}") from error


@contextlib.contextmanager
def _limited_memory() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = psutil.Process().memory_info().data + psutil.virtual_memory().available // 2
    known = [most, *(each for each in (soft, hard) if each != resource.RLIM_INFINITY)]
    resource.setrlimit(resource.RLIMIT_DATA, (min(known), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def installed(kind: str, md5sum: str = "") -> Any:
    """Return the message type `kind` as it is built here.

    Raises ShsaError if it is not known here, or if its sum is not `md5sum`.
    """
    found = message_types.message_class(kind)
    if md5sum not in ("", "*", found._md5sum):
        raise ShsaError(f"{kind} is another version there: its sum is not the one here")
    return found


class Recorded(NamedTuple):
    """A message in a bag: when it was recorded in s, and the publisher as it called itself."""

    topic: str
    message: Any
    time: float
    publisher: str


def messages(bag: Any, wanted: Callable[[str], bool], notes: List[str]) -> Iterator[Recorded]:
    """Read the messages of the wanted topics. Adds to `notes` which types cannot be read here."""

    def known(topic: str, kind: str, md5sum: str, *_: object) -> bool:
        if not wanted(full_name(topic, "/")):
            return False
        try:
            installed(kind, md5sum)
        except ShsaError as error:
            note = f"{shown(topic)} is left out: {error}"
            notes.extend({note}.difference(notes))
            return False
        return True

    for item in bag.read_messages(connection_filter=known, return_connection_header=True):
        publisher = callerid(item.connection_header)
        topic = full_name(item.topic, "/")
        yield Recorded(topic, item.message, item.timestamp.to_sec(), publisher)


class Incident(NamedTuple):
    """The time (s) in which a service had failed, and the node that stood in for it."""

    topic: str
    service: str
    node: str
    begin: float
    end: float
    substitute: str


class _Messages:
    """The messages of one publisher for one service: when recorded, their stamps and values."""

    def __init__(self, values: int, most: int) -> None:
        self._kept = Reservoir(1 + values, False, most)
        self._new: List[List[float]] = []

    def add(self, recorded: float, stamp: float, values: Sequence[Optional[float]]) -> None:
        """Add a message; a value may say that it is no number, or not be there."""
        cells = [
            math.nan if each is None else each if each == each else NO_NUMBER for each in values
        ]
        self._new.append([recorded, stamp, *cells])
        if len(self._new) >= CHUNK_ROWS:
            self._flush()

    def table(self) -> np.ndarray:
        """Return what is kept, a row a message."""
        self._flush()
        return self._kept.table()

    def __len__(self) -> int:
        return self._kept.rows + len(self._new)

    def _flush(self) -> None:
        if self._new:
            self._kept.add(np.array(self._new, dtype=float))
            self._new = []


class _Reader:
    """Reads one bag."""

    def __init__(self, path: str, bag: Any, som: Som, step: Step, most: int) -> None:
        self._path = path
        self._bag = bag
        self._som = som
        self._step, self._most = step, most
        self._nodes = {service.node for service in som}
        self._substitutes: Set[str] = set()
        self._incidents: List[Incident] = []
        self._fields: Dict[Tuple[str, str], Fields] = {}
        self._parts: Dict[Tuple[str, str], _Messages] = {}  # by service and publisher
        self._left_out: Dict[str, int] = {}
        self._unread: List[str] = []

    def read(self) -> Recording:
        """Read the whole bag."""
        self._read_healing()
        topics = set(self._som.topics())
        told, size = 0, os.path.getsize(self._path)
        number = max(1, self._bag.get_message_count(list(topics)))
        for count, recorded in enumerate(messages(self._bag, topics.__contains__, self._unread), 1):
            self._take(*recorded)
            if count % CHUNK_ROWS == 0:
                so_far = int(size * min(1.0, count / number))
                self._step(so_far - told)
                told = so_far
        self._step(size - told)
        series, notes = self._series()
        notes += self._unread
        notes += [f"{_count(n)} left out: {why}" for why, n in self._left_out.items()]
        silent = [t for t in self._som.topics() if not self._has(t)]
        notes += [f"nothing of {topic}" for topic in silent]
        return Recording(self._path, tuple(series), tuple(notes))

    def _read_healing(self) -> None:
        """Read the substitutes and incidents that healing told of."""

        def of_healing(topic: str) -> bool:
            return topic.endswith((SUBSTITUTIONS, INCIDENTS))

        incidents: Dict[Tuple[str, int, str], Incident] = {}
        for topic, message, time, _ in messages(self._bag, of_healing, self._unread):
            if topic.endswith("substitutions"):
                self._substitutes |= {row.node for row in message.substitutions}
            else:
                key = topic, message.id, message.service
                incidents[key] = _incident(message, time)  # the last is the whole story
        self._incidents = list(incidents.values())
        self._substitutes |= {each.substitute for each in self._incidents} - {""}

    def _take(self, topic: str, message: Any, time: float, publisher: str) -> None:
        service = self._som.service_of(topic, publisher)
        why = self._doubt(topic, publisher, service, time)
        if why or service is None:
            self._left_out[why] = self._left_out.get(why, 0) + 1
            return
        fields = self._fields_of(service, message)
        key = service.name, publisher
        if key not in self._parts:
            self._parts[key] = _Messages(len(fields), self._most)
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        stamped = 0.0 if stamp is None else stamp.to_sec()
        self._parts[key].add(time, stamped, [field_value(message, field) for field in fields])

    def _doubt(self, topic: str, publisher: str, service: Optional[Service], time: float) -> str:
        """Return why a message is not what a service measured; empty if it is."""
        name = publisher.rsplit("/", 1)[-1]
        named = name.startswith(PREFIX) or name == PREFIX.rstrip("_")
        if publisher not in self._nodes and (named or publisher in self._substitutes):
            return f"{topic} by the substitute {publisher}"
        if service is None:
            who = publisher or "nobody that the bag names"
            return f"{topic} by {who}, which is no service of the SOM"
        for each in self._incidents:
            if each.topic == topic and each.begin < time < each.end:
                if service.name == each.service or service.node == each.node:
                    return f"{topic} while {each.node} had failed"
        return ""

    def _fields_of(self, service: Service, message: Any) -> Fields:
        """Return the fields of a service in the type that its messages have."""
        key = service.name, message._type
        if key not in self._fields:
            if message._type != service.type:
                raise ModelError(
                    self._path,
                    f"{service.topic} is a {message._type}; the SOM says {service.type}",
                )
            for provision in service.provides:
                try:
                    field_type(message._type, provision.field, message_types.layout)
                except ShsaError as error:
                    raise ModelError(self._path, f"{service.topic}: {error}") from error
            self._fields[key] = tuple(parse_field(p.field) for p in service.provides)
        return self._fields[key]

    def _has(self, topic: str) -> bool:
        return any(self._som.services[name].topic == topic for name, _ in self._parts)

    def _series(self) -> Tuple[List[Series], List[str]]:
        """Return the series of each service, by its own node where that is in the bag."""
        series: List[Series] = []
        notes: List[str] = []
        for name, service in self._som.services.items():
            parts = {publisher: part for (of, publisher), part in self._parts.items() if of == name}
            if service.node in parts:
                for other in sorted(set(parts) - {service.node}):
                    why = f"{service.topic} by {other or 'nobody'}, which is not {service.node}"
                    self._left_out[why] = len(parts[other])
                parts = {service.node: parts[service.node]}
            if parts:
                new, told = _series_of(service, list(parts.values()))
                series += new
                notes += [f"{service.topic} {note}" for note in told]
        return series, notes


def _series_of(service: Service, parts: Sequence[_Messages]) -> Tuple[List[Series], List[str]]:
    """Return the series of the values of a service, and what is to be said of them."""
    table = np.concatenate([part.table() for part in parts])
    time, notes = times_of(table[:, 1], table[:, 0])
    order = ordered(time)
    notes += order.notes
    number = sum(map(len, parts))
    if len(table) < number:
        notes.append(f"has {number} messages: {len(table)} are kept, in stretches")
    series = []
    for place, source in enumerate(service.sources, 2):
        values = table[order.kept, place]
        there = ~np.isnan(values)
        if not there.any():
            notes.append(f"never names {source.provision.field}")
            continue
        times, values = order.time[there], values[there]
        values[values == NO_NUMBER] = math.nan
        low, high = source.provision.range or (-math.inf, math.inf)
        beyond = (values < low) | (values > high)
        if beyond.any():
            notes.append(
                f"has {beyond.sum()} values of {source.property} beyond its range; they are none"
            )
        values[beyond] = math.nan
        series.append(
            Series(source.property, source.path, source.node, times, values, service.name)
        )
    return series, notes


def _incident(message: Any, now: float) -> Incident:
    """Return an incident, from the last good message to the first good one after it."""
    known = [t.to_sec() for t in (message.last_good, message.detected) if not t.is_zero()]
    over = [t.to_sec() for t in (message.returned, message.ended) if not t.is_zero()]
    begin, end = min(known, default=now), min(over, default=math.inf)
    node = message.faulty_node
    return Incident(message.topic, message.service, node, begin, end, message.substitute)


def callerid(header: Mapping[str, Any]) -> str:
    """Return the publisher, as its connection names it."""
    name = header.get("callerid", b"")
    return name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name)


def _count(number: int) -> str:
    return "1 message" if number == 1 else f"{number} messages"

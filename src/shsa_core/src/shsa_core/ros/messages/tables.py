"""Tables sent as changes: a new subscriber, or one that missed a change, gets the whole.

The messages have the fields of shsa_msgs/Health, with other rows; where some subscribers are told
only what concerns them, `to` as well. A table that commands, or that decisions read, is signed.
"""
import io
import threading
import time
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Set, Type

import genpy
import rospy

from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.publishing import advertise, as_written, connections_of, send
from shsa_core.ros.rospy_patches.subscribing import subscribe
from shsa_core.ros.trust.signing import LARGEST_B, Signing

Key = Callable[[Any], str]
"""The key of a row, as `removed` names it."""
Concerns = Callable[[Any, Mapping[str, Any]], bool]
"""Tells of a row of a table by keys, as the table is, that it concerns a subscriber."""
EVERYBODY = ""


class _Channel:
    """The messages to one subscriber, or to all who are told everything; no two have one number."""

    def __init__(self, to: str = EVERYBODY, concerns: Concerns = lambda row, rows: True) -> None:
        self.to, self.concerns = to, concerns
        self.began, self.sequence = time.monotonic_ns(), 0
        self.connections: List[Any] = []


class TablePublisher(rospy.SubscribeListener):
    """Publishes a table: its changes to everybody, the whole of it to whoever connects.

    Rows are messages; `rows_field` is the message's field for them. `signing`: how it is signed;
    None: it is not. `opened`: nobody is told anything before `open`. `concerning`: which rows a
    subscriber of that name is sent; None: all.
    """

    def __init__(
        self,
        topic: str,
        message_class: Type[genpy.Message],
        rows_field: str,
        key: Key,
        signing: Optional[Signing] = None,
        opened: bool = True,
        concerning: Callable[[str], Optional[Concerns]] = lambda subscriber: None,
    ) -> None:
        super().__init__()
        self._class: Any = signing.signed(topic, message_class) if signing else message_class
        self._written = as_written(message_class)
        self._field, self._key = rows_field, key
        self._concerning = concerning
        self._rows: Dict[str, genpy.Message] = {}
        self._channels = {EVERYBODY: _Channel()}
        self._lock = threading.Lock()  # whoever holds it sees table, sequences and queues agree
        self._topic = topic
        self._publisher: Any = None
        if opened:
            self.open()

    def open(self) -> None:
        """Register as a publisher: whoever connects from now on gets the table as it is."""
        with self._lock:
            self._publisher = advertise(self._topic, self._class, settings.QUEUE, self)

    def update(self, changed: Iterable[genpy.Message], removed: Iterable[str] = ()) -> None:
        """Publish new and changed rows, and the keys of those that are gone."""
        rows = {self._key(row): row for row in changed}
        with self._lock:
            gone = [key for key in removed if key in self._rows and key not in rows]
            channels = self._channels.values()
            missed = [self._concerned(channel, gone) for channel in channels]
            self._rows.update(rows)
            for key in gone:
                del self._rows[key]
            for channel, keys in zip(channels, missed):
                keys += self._concerned(channel, rows)
                if keys:
                    self._change(channel, keys)

    def _concerned(self, channel: _Channel, keys: Iterable[str]) -> List[str]:
        return [key for key in keys if channel.concerns(self._rows[key], self._rows)]

    def _change(self, channel: _Channel, keys: List[str]) -> None:
        channel.sequence += 1
        up = [each for each in channel.connections if not each.done]
        if up:
            rows = [self._rows[key] for key in keys if key in self._rows]
            self._send(channel, up, rows, [key for key in keys if key not in self._rows])

    def peer_subscribe(self, *_: object) -> None:
        """Called by rospy, in a thread of its own, once a subscriber has connected."""
        with self._lock:
            known: Set[int] = set()
            for name, channel in list(self._channels.items()):
                channel.connections = [each for each in channel.connections if not each.done]
                known.update(id(each) for each in channel.connections)
                if not channel.connections and name != EVERYBODY:
                    del self._channels[name]
            for connection in connections_of(self._publisher):
                if id(connection) not in known:
                    self._welcome(connection)

    def _welcome(self, connection: Any) -> None:
        name = connection.endpoint_id  # as its subscriber calls itself
        concerns = self._concerning(name)
        if concerns is None:
            channel = self._channels[EVERYBODY]
        else:
            channel = self._channels.setdefault(name, _Channel(name, concerns))
        channel.connections.append(connection)
        rows = [self._rows[key] for key in self._concerned(channel, self._rows)]
        self._send(channel, [connection], rows)

    def _send(
        self,
        channel: _Channel,
        connections: List[Any],
        rows: List[genpy.Message],
        gone: Optional[List[str]] = None,
    ) -> None:
        """Send one message, signed once: who is connected twice knows it again."""
        message = self._class(began=channel.began, whole=gone is None, removed=gone or [])
        message.sequence = message.header.seq = channel.sequence
        message.header.stamp = rospy.Time.now()
        setattr(message, self._field, rows)
        if channel.to:
            message.to = channel.to
        data = io.BytesIO()
        message.serialize(data)
        send(self._publisher, self._written(data.getvalue()), connections)


class TableSubscriber:
    """Calls `heard(message)` with a whole table, or with the changes that follow; never others.

    `heard` is called in rospy's threads, by one at a time. A process may have one subscriber of a
    topic, since rospy shares the connections among all of them. `signing`: what is not signed is
    refused, and what is older than was heard; None: for show, whoever sends it is believed. `name`:
    what is addressed to that name is heard as well; what is addressed to others never is.
    """

    def __init__(
        self,
        topic: str,
        message_class: Type[genpy.Message],
        heard: Callable[[Any], None],
        signing: Optional[Signing] = None,
        name: str = EVERYBODY,
    ) -> None:
        self._topic, self._heard, self._signing, self._name = topic, heard, signing, name
        self._class = signing.checked(topic, message_class) if signing else message_class
        self._lock, self._subscribing = threading.Lock(), threading.Lock()
        self._at = (0, 0)
        """The table that was heard last, and its sequence."""
        self._sent = b"", 0, 0
        """Of the newest message: whose clock, when by that clock, and by ours."""
        self._follows = False
        self._retry: Optional[threading.Timer] = None
        self._subscribe()

    def ask_again(self) -> None:
        """Have the whole table told once more, by a connection of its own; returns at once."""
        with self._lock:
            self._miss()

    def get_num_connections(self) -> int:
        """Return how many publishers are connected."""
        return int(self._subscriber.get_num_connections())

    def _subscribe(self) -> None:
        self._subscribed = time.monotonic()
        how = self._topic, self._class, self._received
        if self._signing is None:
            self._subscriber = subscribe(*how, LARGEST_B)
        else:
            self._subscriber = self._signing.subscribe(*how, self._lost)

    def _received(self, message: Any) -> None:
        with self._lock:
            if getattr(message, "to", EVERYBODY) not in (EVERYBODY, self._name):
                return
            late = self._is_late(message)
            (began, sequence), came = self._at, (message.began, message.sequence)
            follows = self._follows and came == (began, sequence + 1)
            if follows or (message.whole and not late):
                self._at, self._follows = came, True
                self._heard(message)
            elif not (late and self._follows):
                self._miss()

    def _is_late(self, message: Any) -> bool:
        """Return whether a message is known; it may come by two connections, or be kept back."""
        if self._signing is not None:
            boot, sent, here = self._sent
            same = message.boot == boot
            late = message.sent <= sent if same else message.sent_here <= here
            if not late:
                self._sent = message.boot, message.sent, message.sent_here
            return bool(late)
        began, sequence = self._at
        return bool(not message.whole and message.began == began and message.sequence <= sequence)

    def _lost(self) -> None:
        with self._lock:
            if not self._follows:
                self._miss()

    def _miss(self) -> None:
        self._follows = False
        if self._retry is None:
            pause = self._subscribed + settings.FIRST_PAUSE_S - time.monotonic()
            retry = threading.Timer(max(0.0, pause), self._subscribe_again)
            retry.daemon = True
            retry.start()  # which may fail
            self._retry = retry

    def _subscribe_again(self) -> None:
        with self._subscribing:  # it waits for the master: nobody else is to
            with self._lock:
                self._retry = None
                if self._follows or rospy.is_shutdown():
                    return
            self._subscriber.unregister()
            self._subscribe()

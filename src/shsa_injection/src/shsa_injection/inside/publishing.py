"""A fault of one topic, inside the node that publishes it: its messages pass through the fault."""
import copy
import heapq
import itertools
import math
import sys
import threading
import time
from typing import Any, Dict, List, Mapping, Optional, Tuple

import genpy

from shsa_core.errors import ShsaError
from shsa_injection.faults import Reading, Stream, message_fault
from shsa_injection.inside.values import FaultyValue
from shsa_injection.vocabulary import FAULTS

_begun = threading.Lock()
_failing: Dict[str, "PublishingFault"] = {}


class PublishingFault:
    """Lets the messages of a topic pass through a fault, from `begin` to `end`.

    A request has `topic`, `fault`, `seed`, `seconds` (None: until its end), `values`: field and
    range of each value, and `period` in s or None. Meanwhile the topic's publisher has a `publish`
    of ours, in place of the one of its class; every call of the node goes through that.
    """

    def __init__(self, request: Mapping[str, Any]) -> None:
        word = str(request["fault"])
        self._topic = str(request["topic"])
        self._seconds = request["seconds"]
        self._publisher = _publisher(self._topic)
        self._class = self._publisher.data_class
        self._fields = [FaultyValue(self._class, str(field)) for field, _ in request["values"]]
        self._stamped = bool(self._class._has_header)
        if FAULTS[word].stamp and not self._stamped:
            raise ShsaError(f"messages of {self._topic} have no stamp: {self._class._type}")
        layout = zip(self._class.__slots__, self._class._slot_types)
        self._arrays = [name for name, kind in layout if kind.endswith("[]")]
        if word == "short_array" and not self._arrays:
            raise ShsaError(f"messages of {self._topic} have no array: {self._class._type}")
        ranges = tuple(
            None if each is None else (each[0], each[1]) for _, each in request["values"]
        )
        self._fault = message_fault(word, int(request["seed"]), Stream(request["period"], ranges))
        self.detail = self._fault.detail
        self._waiting: List[Tuple[float, int, genpy.Message]] = []
        self._order = itertools.count()
        self._changed = threading.Condition()
        self._on = False
        self._counts = {"came": 0, "published": 0, "changed": 0}

    def begin(self) -> float:
        """Fail from now on; until when, in s of the monotonic clock."""
        with _begun:
            if self._topic in _failing:
                raise ShsaError(f"{self._topic} fails already")
            _failing[self._topic] = self
        self._on = True
        threading.Thread(target=self._publish_late, daemon=True).start()
        self._publisher.publish = self._publish
        return math.inf if self._seconds is None else time.monotonic() + float(self._seconds)

    def end(self) -> Dict[str, int]:
        """Be well again; how many messages came, were published, and were other than they came.

        What is still delayed is never published.
        """
        # A closed publisher has no lock and publishes no more.
        self._publisher.acquire()
        try:
            del self._publisher.publish
        finally:
            self._publisher.release()
        with self._changed:
            self._on = False
            self._changed.notify()
        with _begun:
            del _failing[self._topic]
        return self._counts

    def _publish(self, message: genpy.Message, connection_override: Any = None) -> Any:
        """Replaces rospy's method; the caller holds the publisher's lock."""
        if connection_override is not None:  # a latched message, for a new subscriber
            return type(self._publisher).publish(self._publisher, message, connection_override)
        now = time.monotonic()
        reading = self._read(message)
        self._counts["came"] += 1
        for at, other in self._fault.feed(now, reading):
            changed = self._changed_message(message, reading, other)
            self._counts["changed"] += changed is not message
            if at <= now:
                self._publish_now(changed)
            else:
                with self._changed:
                    # A copy: the node may use its message again meanwhile.
                    later = copy.deepcopy(changed)
                    heapq.heappush(self._waiting, (at, next(self._order), later))
                    self._changed.notify()
        return True

    def _publish_now(self, message: genpy.Message) -> None:
        self._counts["published"] += 1
        type(self._publisher).publish(self._publisher, message)

    def _publish_late(self) -> None:
        """Publish what is delayed when it is due, in a thread of its own."""
        while True:
            with self._changed:
                while self._on and not self._due():
                    first = self._waiting[0][0] if self._waiting else math.inf
                    left = first - time.monotonic()
                    self._changed.wait(None if left == math.inf else max(0.0, left))
                if not self._on:
                    return
                _, _, message = heapq.heappop(self._waiting)
            self._publisher.acquire()
            try:
                if self._on and not self._publisher.closed:
                    self._publish_now(message)
            finally:
                self._publisher.release()

    def _due(self) -> bool:
        return bool(self._waiting) and self._waiting[0][0] <= time.monotonic()

    def _read(self, message: genpy.Message) -> Reading:
        stamp = message.header.stamp.to_sec() if self._stamped else None
        frame = message.header.frame_id if self._stamped else None
        return Reading(tuple(field.get(message) for field in self._fields), stamp, frame)

    def _changed_message(
        self, message: genpy.Message, reading: Reading, other: Reading
    ) -> genpy.Message:
        """Return the message with what is other in it; the message itself if nothing is."""
        if other == reading:
            return message
        changed = copy.deepcopy(message)
        if other.stamp is not None and other.stamp != reading.stamp:
            changed.header.stamp = genpy.Time.from_sec(other.stamp)
        for field, before, value in zip(self._fields, reading.values, other.values):
            if value is not None and value != before:
                field.set(changed, value)
        if other.frame is not None:
            changed.header.frame_id = other.frame
        for name in self._arrays if other.share < 1.0 else ():
            array = getattr(changed, name)
            setattr(changed, name, array[: int(other.share * len(array))])
        return changed


def _publisher(topic: str) -> Any:
    """rospy's publisher of a topic in this process. Raises ShsaError if there is none."""
    topics = sys.modules.get("rospy.topics")
    manager = getattr(topics, "get_topic_manager", lambda: None)()
    publisher: Optional[Any] = manager and manager.pubs.get(topic)
    if publisher is None:
        raise ShsaError(f"this process does not publish {topic} by rospy")
    return publisher

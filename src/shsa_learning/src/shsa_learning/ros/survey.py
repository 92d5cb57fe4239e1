"""Surveys a running robot: listens to all topics for a while, and does nothing else."""
import queue
import threading
import time
from typing import Callable, Dict, List, NamedTuple, Optional, Set, Tuple

import rosgraph
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.analysis.registrations import read_pairs
from shsa_core.ros.rospy_patches.subscribing import subscribe
from shsa_core.text import shown
from shsa_learning.init.draft import UNLISTED, Listed
from shsa_learning.init.survey import (
    LARGEST_MESSAGE_B,
    Publisher,
    Refused,
    Survey,
    Surveyor,
    outside,
)
from shsa_learning.ros.contents import Values

AT_ONCE = 300
"""Topics that are listened to at the same time: each takes a thread and a descriptor or more."""
MOST_TOPICS = 3000
LOOK_S = 1.0
"""So often the master is asked who is new."""
LARGEST_B = 64 * 1024 * 1024
WAITING_B = 32 * 1024 * 1024
"""Bytes of messages that wait to be read; of those beyond, only the time counts."""


class Arrival(NamedTuple):
    """A message as it came at `time`, monotonic s; `data` is None if it is not to be read."""

    topic: str
    time: float
    header: Dict[str, str]
    size: int
    data: Optional[bytes]


class _Inbox:
    """A queue that rospy's threads fill and one thread reads."""

    def __init__(self) -> None:
        self._queue: "queue.Queue[Arrival]" = queue.Queue()
        self._waiting, self._lock = 0, threading.Lock()

    def put(self, topic: str, message: rospy.AnyMsg) -> None:
        """Called by rospy for every message."""
        now, data, size = time.monotonic(), message._buff, len(message._buff)
        with self._lock:
            if size > LARGEST_MESSAGE_B or self._waiting + size > WAITING_B:
                data = None
            else:
                self._waiting += size
        self._queue.put(Arrival(topic, now, message._connection_header, size, data))

    def take(self, seconds: float) -> Optional[Arrival]:
        """Return the next message; None if none came in time."""
        try:
            arrival = self._queue.get(timeout=max(1e-3, seconds))
        except queue.Empty:
            return None
        if arrival.data is not None:
            with self._lock:
                self._waiting -= arrival.size
        return arrival


class _Graph:
    """The publishers of each topic, and all else that the master lists."""

    def __init__(self) -> None:
        self.types: Dict[str, str] = {}
        self.publishers: Dict[str, Set[str]] = {}
        self.listed: Listed = UNLISTED

    def look(self) -> None:
        """Ask the master. Raises ShsaError if it does not answer."""
        try:
            master = master_api()
            publishers, subscribers, services = master.getSystemState()
            types = master.getTopicTypes()
        except FAILURES as error:
            raise ShsaError(
                f"no ROS master answers at {rosgraph.get_master_uri()}: start the robot, "
                f"or give a recording with --bag ({shown(error, 200)})"
            ) from error
        self.types = {str(topic): str(kind) for topic, kind in types}
        self.publishers = {str(topic): set(map(str, nodes)) for topic, nodes in publishers}
        self.listed = read_pairs(publishers), read_pairs(subscribers), read_pairs(services)


def survey_robot(seconds: float, say: Callable[[str], None]) -> Tuple[Survey, List[str], Listed]:
    """Return what a running robot says for `seconds`, what else is to be told, and who is listed.

    Many topics are listened to in turn, each for `seconds`. Raises ShsaError if no master answers.
    """
    graph = _Graph()
    graph.look()
    rospy.init_node("shsa_init", anonymous=True, disable_signals=True, disable_rostime=True)
    return (*_Listening(graph, seconds, say).run(), graph.listed)


class _Listening:
    """Listens to some topics after the others."""

    def __init__(self, graph: _Graph, seconds: float, say: Callable[[str], None]) -> None:
        self._graph, self._seconds, self._say = graph, seconds, say
        self._surveyor = Surveyor()
        self._values = Values(self._surveyor)
        self._begun: Set[str] = set()
        self._inbox = _Inbox()

    def run(self) -> Tuple[Survey, List[str]]:
        """Survey all topics, and those that come meanwhile."""
        begin, notes = time.monotonic(), []
        while True:
            group = self._next(AT_ONCE)
            if not group and self._begun:
                break
            told = f"listening to {len(group)} topics for {self._seconds:g} s"
            more = len(self._graph.publishers) - len(self._begun) - len(group)
            self._say(f"{told}; {more} more to follow" if len(group) == AT_ONCE else told)
            self._listen(group)
            if len(group) < AT_ONCE:
                break
        for topic, nodes in self._graph.publishers.items():
            for node in nodes:
                kind = self._graph.types.get(topic, "")
                self._values.unheard(Publisher(topic, kind, node))
        if "/clock" in self._graph.publishers:
            notes.append("Time is simulated here: periods are as the computer ran, not by /clock.")
        return self._surveyor.result(begin, time.monotonic()), notes

    def _next(self, most: int) -> List[str]:
        """Topics that nobody has listened to yet."""
        known = [topic for topic in sorted(self._graph.publishers) if topic not in self._begun]
        wanted = [each for each in known if not outside(each, self._graph.types.get(each, ""), "")]
        return wanted[: min(most, MOST_TOPICS - len(self._begun))]

    def _listen(self, group: List[str]) -> None:
        end = time.monotonic() + self._seconds
        subscribers = [self._subscribe(topic) for topic in group]
        look = time.monotonic() + LOOK_S
        while time.monotonic() < end:
            arrival = self._inbox.take(min(end, look) - time.monotonic())
            if arrival is not None:
                self._hear(arrival)
            if time.monotonic() >= look:
                self._graph.look()
                subscribers += [self._subscribe(t) for t in self._next(AT_ONCE - len(subscribers))]
                look = time.monotonic() + LOOK_S
        for subscriber in subscribers:
            self._surveyor.stops(subscriber.resolved_name, end)
            subscriber.unregister()
        while True:
            arrival = self._inbox.take(0.0)
            if arrival is None:
                break
            if arrival.time <= end:
                self._hear(arrival)

    def _subscribe(self, topic: str) -> rospy.Subscriber:
        self._begun.add(topic)

        def put(message: rospy.AnyMsg) -> None:
            self._inbox.put(topic, message)

        return subscribe(topic, rospy.AnyMsg, put, LARGEST_B)

    def _hear(self, arrival: Arrival) -> None:
        header = arrival.header
        publisher = Publisher(arrival.topic, header.get("type", ""), header.get("callerid", ""))
        if publisher.node not in self._graph.publishers.get(arrival.topic, ()):
            why = "the master does not list it there"
            self._surveyor.refuse(Refused(*publisher, why))
            return
        reader = self._values.takes(publisher, header.get("md5sum", ""))
        if reader is not None:
            self._surveyor.heard(publisher, arrival.time, header.get("latching") == "1")
            self._values.read(publisher, reader, arrival.size, arrival.data)

"""An independent observer: hears every topic of the SOM itself, and what healing says of it."""
import collections
import threading
import time
from contextlib import suppress
from functools import partial
from typing import Any, Callable, Deque, Dict, List, Sequence, Tuple

import psutil
import rospy
from shsa_msgs.msg import Failure, Incident, Substitutions

from shsa_core.model.names import full_name
from shsa_core.model.service import Deadlines, Service
from shsa_core.model.som import Som
from shsa_core.model.substitution import row_key
from shsa_core.ros.messages.tables import TableSubscriber
from shsa_core.ros.wire import names
from shsa_injection.errors import Refused
from shsa_injection.findings import Told
from shsa_injection.invariants import Case, Seen, Topic, Usage
from shsa_injection.ros import healers, targets

KEPT_MESSAGES = 20000  # of each topic
KEPT_FAILURES = 2000


def watched(som: Som, deadlines: Deadlines = Deadlines()) -> List[Topic]:
    """Return the periodical topics of a SOM; event-driven ones may be silent for any time."""
    found = []
    for name in som.topics():
        services = [each for each in som.of_topic(name) if each.period is not None]
        if not services:
            continue
        period = max(each.period or 0.0 for each in services)
        deadline = max(deadlines.longest(each) or 0.0 for each in services)
        nodes = frozenset(each.node for each in services)
        needed = any(each.needed for each in services)
        found.append(Topic(name, nodes, period, deadline, needed))
    return found


class Observer:
    """Watches a robot that heals itself.

    `told(event, details)` is called when an incident has changed.
    """

    def __init__(self, som: Som, namespace: str, told: Callable[..., None]) -> None:
        self.topics = watched(som)
        self._nodes: Dict[str, Service] = {}
        for service in som:
            self._nodes.setdefault(service.node, service)
        self._namespace, self._told = namespace, told
        self._heard: Dict[str, Deque[Tuple[float, str]]] = {}
        self._cases: Dict[Tuple[int, str], Case] = {}
        self._processes_known: Dict[str, psutil.Process] = {}
        self._failures: Deque[Told] = collections.deque(maxlen=KEPT_FAILURES)
        self._lock = threading.Lock()
        for topic in self.topics:
            self._heard[topic.name] = collections.deque(maxlen=KEPT_MESSAGES)
            rospy.Subscriber(
                topic.name, rospy.AnyMsg, partial(self._message, topic.name), tcp_nodelay=True
            )
        place = partial(full_name, namespace=namespace)
        rospy.Subscriber(place(names.INCIDENTS), Incident, self._incident)
        rospy.Subscriber(place(names.FAILURES), Failure, self._failure)
        self._listed: Dict[str, str] = {}  # the nodes of the table of substitutions
        TableSubscriber(place(names.SUBSTITUTIONS), Substitutions, self._substitutions)

    def _substitutions(self, change: Substitutions) -> None:
        listed = {} if change.whole else dict(self._listed)
        listed.update({row_key(row): row.node for row in change.substitutions})
        self._listed = {key: listed[key] for key in listed if key not in change.removed}

    def seen(self, nodes: bool = True) -> Seen:
        """Look at the system; without `nodes`, not at what costs a call to every node."""
        with self._lock:
            heard = {topic: list(each) for topic, each in self._heard.items()}
            cases = list(self._cases.values())
        listed = frozenset(filter(None, self._listed.values()))
        return Seen(
            now=time.monotonic(),
            heard=heard,
            cases=cases,
            processes=self._processes() if nodes else {},
            ours=healers.substitutes(self._namespace),
            listed=listed,
            healers=self._usage() if nodes else {},
        )

    def failures(self, since: float) -> List[Told]:
        """Return the failures that healing has told of since a moment."""
        with self._lock:
            return [each for each in self._failures if each.at >= since]

    def forget(self) -> None:
        """Keep what was heard lately alone."""
        limit = time.monotonic() - 5.0
        with self._lock:
            for heard in self._heard.values():
                while heard and heard[0][0] < limit:
                    heard.popleft()

    def _processes(self) -> Dict[str, Tuple[int, float]]:
        """Ask the master for those alone that are not known to live: it may have been restarted."""
        for node, service in self._nodes.items():
            known = self._processes_known.get(node)
            if known is not None and targets.lives(known):
                continue
            self._processes_known.pop(node, None)
            with suppress(Refused, psutil.Error):  # it is not up
                self._processes_known[node] = targets.find(service).process
        found = {}
        for node, process in self._processes_known.items():
            with suppress(psutil.Error):  # it has ended just now
                found[node] = (int(process.pid), float(process.create_time()))
        return found

    def _usage(self) -> Dict[str, Usage]:
        found = {}
        for healer in healers.running():
            if healer.namespace != self._namespace:
                continue
            try:
                process = healer.process
                with process.oneshot():
                    memory, threads = process.memory_info().rss, process.num_threads()
                    found[healer.node] = Usage(memory, process.num_fds(), threads)
            except psutil.Error:
                continue  # it has ended meanwhile
        return found

    def _message(self, topic: str, message: Any) -> None:
        now = time.monotonic()
        who = message._connection_header["callerid"]
        with self._lock:
            self._heard[topic].append((now, who))

    def _failure(self, failure: Failure) -> None:
        told = Told(time.monotonic(), failure.topic, failure.publisher, failure.kind)
        with self._lock:
            self._failures.append(told)

    def _incident(self, incident: Incident) -> None:
        case = Case(int(incident.id), incident.topic, incident.state, bool(incident.kept_out))
        with self._lock:
            # A new reconfigurator may count from 1 again: the last that was told is the newest.
            changed = self._cases.pop((case.id, case.topic), None) != case
            self._cases[case.id, case.topic] = case
        if changed:
            self._told(
                "incident",
                id=case.id,
                topic=case.topic,
                state=case.state,
                kind=incident.kind,
                node=incident.faulty_node,
                substitute=incident.substitute,
            )


def last_heard(seen: Seen, topics: Sequence[Topic]) -> Dict[str, str]:
    """Return the last publisher of each topic."""
    found = {}
    for topic in topics:
        heard = seen.heard.get(topic.name)
        if heard:
            found[topic.name] = heard[-1][1]
    return found

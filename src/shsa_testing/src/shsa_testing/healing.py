"""The messages of healing, and the publishers of a topic, as a test hears them."""
import threading
import time
from typing import Any, Dict, List, Optional, Tuple

import rospy
from shsa_msgs.msg import Incident, ServiceState, SomState, Substitution, Substitutions

from shsa_core.ros import clock
from shsa_core.ros.rospy_patches.subscribing import subscribe
from shsa_core.ros.trust.signing import LARGEST_B
from shsa_testing.graph import publishers
from shsa_testing.waiting import wait_until


class TopicRecord:
    """The publishers of a topic and their times (monotonic, s); `last`: the newest message.

    `newest` has that of each node.
    """

    def __init__(self, topic: str, message_class: type = rospy.AnyMsg) -> None:
        self.heard: List[Tuple[float, str]] = []
        self.last: Any = None
        self.newest: Dict[str, Any] = {}
        self._subscriber = rospy.Subscriber(topic, message_class, self._received, tcp_nodelay=True)

    def _received(self, message: Any) -> None:
        node = message._connection_header["callerid"]
        self.last = self.newest[node] = message
        self.heard.append((time.monotonic(), node))

    def times(self, node: str) -> List[float]:
        """Return the times at which `node` published."""
        return [at for at, who in list(self.heard) if who == node]

    def others(self, node: str, since: float) -> List[Tuple[float, str]]:
        """Return the other publishers since a moment."""
        return [(at, who) for at, who in list(self.heard) if who != node and at >= since]

    def await_node(self, node: str, seconds: float = 20.0) -> None:
        """Wait until `node` publishes from now on."""
        now = time.monotonic()
        heard = self.heard
        wait_until(
            lambda: any(who == node and at > now for at, who in reversed(heard[-50:])),
            seconds,
            f"{node} publishes",
        )


class HealedRobot:
    """The state of healing in a namespace: incidents, substitutions, services."""

    def __init__(self, namespace: str = "") -> None:
        self.incidents: Dict[int, Incident] = {}
        self._steps: List[Incident] = []  # since somebody began to wait
        self._substitutions: Dict[str, Substitution] = {}
        self._services: Dict[str, ServiceState] = {}
        self._lock = threading.Lock()
        shsa = f"{namespace}/shsa"
        # A table comes whole as rospy connects, which may be before its subscriber calls back.
        subscribe(f"{shsa}/incidents", Incident, self._incident, LARGEST_B)
        subscribe(f"{shsa}/substitutions", Substitutions, self._substitutions_changed, LARGEST_B)
        subscribe(f"{shsa}/som_state", SomState, self._som_changed, LARGEST_B)

    def _incident(self, incident: Incident) -> None:
        with self._lock:
            self.incidents[incident.id] = incident
            self._steps.append(incident)

    def _substitutions_changed(self, change: Substitutions) -> None:
        if not change._connection_header["callerid"].endswith("/reconfigurator"):
            return  # a stranger says so, whom healing refuses as well
        rows = {_key(row): row for row in change.substitutions}
        self._substitutions = _changed(self._substitutions, change, rows)

    def _som_changed(self, change: SomState) -> None:
        rows = {row.service: row for row in change.services}
        self._services = _changed(self._services, change, rows)

    def forget(self) -> None:
        """Forget what a healing that has ended has told."""
        self._substitutions, self._services = {}, {}

    @property
    def substitutions(self) -> List[Substitution]:
        """The rows of processes in the table of substitutions.

        The others are plans of warm services.
        """
        return [row for row in self._substitutions.values() if row.node]

    @property
    def services(self) -> List[ServiceState]:
        """The rows of the running SOM."""
        return list(self._services.values())

    def latest(self, topic: str) -> Optional[Incident]:
        """Return the newest incident of a topic."""
        with self._lock:
            known = [i for i in self.incidents.values() if i.topic == topic]
        return max(known, key=lambda each: int(each.id)) if known else None

    def publishers(self, topic: str) -> List[str]:
        """Return the nodes registered as publishers of a topic, save the pool's idle processes."""
        idle = {row.node for row in self.substitutions if not row.service}
        return [node for node in publishers(topic) if node not in idle]

    def await_state(self, topic: str, state: str, seconds: float = 20.0) -> Incident:
        """Wait until the newest incident of a topic is in a state; "healing" may soon be over."""
        del self._steps[:]

        def reached() -> Optional[Incident]:
            incident = self.latest(topic)
            passed = [i for i in self._steps if (i.topic, i.state) == (topic, "healing")]
            if state == "healing" and passed:
                return passed[-1]
            return incident if incident is not None and incident.state == state else None

        return wait_until(reached, seconds, f"the incident of {topic} is {state}")

    def await_available(self, *topics: str, seconds: float = 30.0) -> None:
        """Wait until all services of the topics are available."""

        def available() -> bool:
            states: Dict[str, bool] = {}
            for row in self.services:
                states[row.topic] = states.get(row.topic, True) and row.available
            return all(states.get(topic) for topic in topics)

        wait_until(available, seconds, f"{', '.join(topics)} available")

    def await_verified(self, *nodes: str, seconds: float = 30.0) -> None:
        """Wait until healing knows which processes these nodes are."""

        def verified() -> bool:
            return {*nodes} <= {node for row in self.services for node in row.verified}

        wait_until(verified, seconds, f"{', '.join(nodes)} verified")


def _key(row: Substitution) -> str:
    """Return the key of a row of the table of substitutions."""
    return f"{row.node} {row.service}" if row.shared else row.node or row.service


def _changed(old: Dict[str, Any], change: Any, rows: Dict[str, Any]) -> Dict[str, Any]:
    """Return a table after a change; the whole replaces it."""
    kept = {} if change.whole else old
    return {**{key: row for key, row in kept.items() if key not in change.removed}, **rows}


def moment_of(stamp: rospy.Time) -> float:
    """Return the moment of a stamp by the clock of this computer, in s; 0 for none."""
    return clock.to_moment(stamp, clock.offset()) or 0.0

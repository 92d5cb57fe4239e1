"""What the monitor knows of the publishers of a watched topic."""
from dataclasses import dataclass, field
from math import inf
from typing import Dict, List, Optional

from shsa_core.monitoring.events import FAILED, HEALTHY, UNKNOWN, PublisherHealth
from shsa_core.monitoring.evidence import Evidence, TopicChecks


@dataclass
class Publisher:
    """What is known of one publisher of one topic. Times in s; `granted`: extra time until it counts as silent."""

    name: str
    since: float
    evidence: Evidence
    state: str = UNKNOWN
    connected: bool = True
    kind: str = ""
    detail: str = ""
    first_message: Optional[float] = None
    last_message: Optional[float] = None
    last_good: Optional[float] = None
    messages: int = 0
    good_in_a_row: int = 0
    granted: float = 0.0
    intruding_since: Optional[float] = None

    def become(self, time: float, state: str, kind: str = "", detail: str = "") -> None:
        """Enter a state."""
        self.state, self.since, self.kind, self.detail = state, time, kind, detail
        self.good_in_a_row = 0

    def note_message(self, time: float) -> None:
        """Count a message."""
        self.messages += 1
        self.last_message, self.granted = time, 0.0
        if self.first_message is None:
            self.first_message = time

    def row(self, topic: str) -> PublisherHealth:
        """Its row in the table."""
        moments = (self.since, self.first_message, self.last_good)
        return PublisherHealth(topic, self.name, self.state, *moments, self.kind, self.detail)


@dataclass
class WatchedTopic:
    """One watched topic and its publishers; while there is none, one without a name.

    `allowed`: s without a message; `began`: when it was first watched; `spoke`: whether any message ever came;
    `overdue`: whether it was reported that none did.
    """

    name: str
    node: str
    checks: TopicChecks
    allowed: float
    began: float
    spoke: bool = False
    overdue: bool = False
    publishers: Dict[str, Publisher] = field(default_factory=dict)

    def check(self, node: str, checks: TopicChecks, allowed: float) -> None:
        """Go by another version of the SOM."""
        if checks != self.checks:
            for publisher in self.publishers.values():
                publisher.evidence = Evidence(checks)
        self.node, self.checks, self.allowed = node, checks, allowed

    def meet(self, name: str, time: float) -> Publisher:
        """A new publisher, in place of an old one of that name."""
        self.publishers.pop("", None)
        publisher = Publisher(name, time, Evidence(self.checks))
        self.publishers[name] = publisher
        return publisher

    def expect(self, time: float) -> Publisher:
        """The publisher without a name: somebody should be there."""
        nobody = Publisher("", time, Evidence(self.checks), connected=False)
        return self.publishers.setdefault("", nobody)

    def hush(self, publisher: Publisher, time: float) -> None:
        """Begin anew with a publisher that was muted."""
        publisher.become(time, UNKNOWN)
        publisher.evidence = Evidence(self.checks)
        publisher.first_message = publisher.last_message = None

    def deadline(self, publisher: Publisher) -> float:
        """When silence becomes a failure; inf: it does not."""
        if publisher.last_message is None or publisher.state == FAILED:
            return inf
        return publisher.last_message + self.allowed + publisher.granted

    def healthy(self) -> List[Publisher]:
        """The healthy publishers."""
        return [p for p in self.publishers.values() if p.state == HEALTHY]

    def forget_gone(self) -> None:
        """Drop publishers that are gone and missed by nobody: neither the SOM's node nor the last hope."""
        if self.healthy():
            for gone in [p for p in self.publishers.values() if not p.connected]:
                if gone.name != self.node:
                    del self.publishers[gone.name]

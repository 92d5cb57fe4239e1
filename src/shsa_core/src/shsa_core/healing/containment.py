"""Decides about a faulty node by what would be lost with it."""
from dataclasses import dataclass
from typing import List, Optional, Sequence, Set, Tuple

from shsa_core.healing.health import MISSED
from shsa_core.healing.incident import SUBSTITUTED
from shsa_core.healing.robot import Robot
from shsa_core.model.checks import BY_VALUE
from shsa_core.model.health import PublisherHealth
from shsa_core.model.kinds import BY_CLOCK, Contain, Kind, Policy
from shsa_core.model.service import LastResort, Service

Published = List[Tuple[Service, PublisherHealth]]


@dataclass(frozen=True)
class Charge:
    """A node that failed on one topic, and what is known of the rest.

    `contain`: what the SOM says of the failed service. `restarted`: by its policy the node is
    started again. `never`: why it is never killed, whatever the SOM says of this service.
    `protected`: why it is never killed unless the SOM says so; empty: it may be.
    `replaced`: something takes the failed service over. `costs`: the needed topics that would be
    lost with the node, and that nothing replaces. `duties`: what the node does beyond the SOM.
    `safe`: the SOM has a last resort for the topic.
    `was_good`: it has published the failed topic well before. `gated`: a gate stands between it and
    the consumers of that topic. `elsewhere`: it is on another computer than healing.
    """

    node: str
    topic: str
    kind: Kind
    contain: Optional[Contain] = None
    restarted: bool = False
    never: str = ""
    protected: str = ""
    replaced: bool = False
    costs: Tuple[str, ...] = ()
    duties: Tuple[str, ...] = ()
    safe: bool = False
    was_good: bool = True
    gated: bool = False
    elsewhere: bool = False


@dataclass(frozen=True)
class Verdict:
    """Says whether a node is killed, and why, in words."""

    kill: bool
    why: str


def decide(charge: Charge) -> Verdict:
    """Decide about a faulty node: docs/explanation/killing.md has it as a table."""
    topic, gone = charge.topic, charge.kind is Kind.NODE_GONE
    killed = f"{charge.node} is {'ended if it still runs' if gone else 'killed'}"
    kept = f"{charge.node} is {'left alone if it still runs' if gone else 'kept'}"
    if charge.never:
        return Verdict(False, f"{kept}: {charge.never}")
    if charge.contain is not None:
        kill = charge.contain is Contain.NODE
        return Verdict(kill, f"{killed if kill else kept}: the SOM says so of {topic}")
    if charge.protected:
        return Verdict(False, f"{kept}: {charge.protected}")
    if charge.kind in (Kind.FRAME, Kind.LENGTH):
        return Verdict(False, f"{kept}: its settings may have been changed")
    if charge.elsewhere and charge.kind in BY_CLOCK:
        return Verdict(False, f"{kept}: the clock of its computer may have been set")
    silent = charge.kind in MISSED
    if charge.restarted:
        until = " if it stays silent" if silent else ""
        return Verdict(True, f"{killed}{until}: its policy is to start it again")
    if silent or gone:
        # Hung or slow, nobody can tell; a substitute that fills in yields once it speaks. One that
        # has gone and still runs, as it shuts down, is silent as well.
        return Verdict(False, f"{kept}: it may speak again, and ending it would gain nothing")
    if charge.gated and charge.kind is not Kind.REQUESTED:
        return Verdict(False, f"{kept}: a gate keeps from consumers what it publishes on {topic}")
    if charge.costs:
        lost = f"killing it would cost {_enumerated(charge.costs)}, which nothing can replace"
        return Verdict(False, f"{kept}: {lost}")
    if charge.duties:
        return Verdict(False, f"{kept}: it {_enumerated(charge.duties)}, which nothing takes over")
    if charge.kind in BY_VALUE and not charge.was_good:
        # By the same numbers a substitute may be no better, and then there would be nobody.
        why = f"{topic} was never good: it may not be ready yet, or the SOM is wrong"
        return Verdict(False, f"{kept}: {why}")
    if charge.replaced:
        return Verdict(True, f"{killed}: what is needed of it is taken over")
    if charge.safe and charge.kind is not Kind.REQUESTED:
        return Verdict(True, f"{killed}: nothing but its last resort is left")
    # It may be good again, or good in between: without it there would be nobody.
    return Verdict(False, f"{kept}: nothing can replace {topic}")


def _enumerated(topics: Sequence[str]) -> str:
    return " and ".join([", ".join(topics[:-1]), topics[-1]] if len(topics) > 1 else topics)


class Stakes:
    """Looks what a node still does well, and who relies on it: that costs what it publishes."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._health = robot.health

    def verdict(
        self, service: Service, node: str, kind: Kind, replaced: bool, restarted: bool = False
    ) -> Verdict:
        """Decide about a node by all that is at stake; where healing advises, it says so."""
        published = self._published(node)
        warm = self._robot.time - self._robot.settings.stable
        charge = Charge(
            node,
            service.topic,
            kind,
            service.contain,
            restarted,
            self._never(service, node, published),
            self._health.protected.get(node, ""),
            replaced,
            tuple(sorted(self._costs(service, node, published))),
            self._health.duties.get(node, ()),
            service.last_resort != LastResort(),
            self._health.was_good((service.topic, node), warm),
            service.gated,
            bool(self._robot.host_of(node)),
        )
        verdict = decide(charge)
        if service.policy is not Policy.ADVISE:
            return verdict
        why = self._robot.waiting(service) or "healing advises"
        return Verdict(False, f"nothing is done, as {why}; else {verdict.why}")

    def _never(self, failed: Service, node: str, published: Published) -> str:
        """Return why a node is not to be killed for what is said of a service not its own."""
        if self._robot.names.of_healing(node, in_som=node == failed.node):
            return "it belongs to healing or to ROS"
        for service, row in published:
            if row.is_well and service.needed and service.node == node != failed.node:
                return f"the SOM names it for {service.topic}, which is needed and good"
        return ""

    def _costs(self, failed: Service, node: str, published: Published) -> Set[str]:
        others = self._health.doomed - {node}
        doomed = others | {node}
        lost: Set[str] = set()
        for service, row in published:
            counts = service.needed and service.name != failed.name
            if counts and not self._remains(service, doomed):
                lost.add(service.topic)
            if row.is_well:
                lost.update(self._relying(service, doomed))
        # What goes with a node that is being killed was to be replaced, perhaps by this one.
        for other in sorted(others):
            for service, row in self._published(other):
                promised = service.needed and row.is_well and self._remains(service, others)
                if promised and not self._remains(service, doomed):
                    lost.add(service.topic)
        return lost

    def _published(self, node: str) -> Published:
        service_of, rows = self._robot.som.service_of, self._health.rows
        topics = sorted(self._health.topics.get(node, ()))
        found = ((service_of(topic, node), rows[topic][node]) for topic in topics)
        return [(service, row) for service, row in found if service is not None]

    def _remains(self, service: Service, doomed: Set[str]) -> bool:
        well = self._health.well(service.topic)
        remain = (each not in doomed and each not in self._health.substitutes for each in well)
        return any(remain) or self._robot.planner.replaceable(service, doomed)

    def _relying(self, service: Service, doomed: Set[str]) -> List[str]:
        """Return the topics that a substitute computes from a service, and nothing else gives."""
        found, indexes = [], self._robot.indexes
        for name in indexes.readers([service.name]):
            read = self._robot.som.services.get(name)
            if read is not None and name in indexes.healing:
                incident, tried = indexes.healing[name]
                without = doomed | {incident.faulty_node}
                computed = incident.state in SUBSTITUTED
                if computed and not self._robot.planner.replaceable(read, without, tried):
                    found.append(read.topic)
        return found

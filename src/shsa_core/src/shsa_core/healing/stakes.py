"""What is at stake with a node: what it still does well, and what relies on it.

A question about a node costs what it publishes, not what the robot is large.
"""
from typing import Dict, FrozenSet, Iterator, List, Set, Tuple

from shsa_core.healing.concern import Concern
from shsa_core.healing.containment import Case, Verdict, decide
from shsa_core.healing.incident import State
from shsa_core.healing.kills import Kills
from shsa_core.healing.naming import Names
from shsa_core.healing.nodes import Nodes
from shsa_core.healing.planner import Planner
from shsa_core.healing.topic import TopicHealing
from shsa_core.model.kinds import QUIET, Kind, Policy
from shsa_core.model.service import Service
from shsa_core.monitoring.events import PublisherHealth, PublisherState

COMPUTED = (State.HEALING, State.HEALED)


class Stakes:
    """Judges faulty nodes; `healings` by their service."""

    def __init__(
        self,
        names: Names,
        nodes: Nodes,
        kills: Kills,
        concern: Concern,
        healings: Dict[str, TopicHealing],
    ) -> None:
        self._names = names
        self._nodes = nodes
        self._kills = kills
        self._concern = concern
        self._healings = healings

    def verdict(
        self,
        planner: Planner,
        service: Service,
        waiting: str,
        node: str,
        kind: Kind,
        replaced: bool,
        restarted: bool,
    ) -> Verdict:
        """What is to be done about a node that failed on the topic of a service.

        `waiting`: why nothing is done for the time being; empty: the policy decides that.
        """
        case = Case(
            node,
            service.topic,
            kind,
            service.contain,
            restarted,
            self._never(planner, service, node),
            self._nodes.protected.get(node, ""),
            replaced,
            tuple(sorted(self._costs(planner, service, node))),
            tuple(sorted(self._useful(planner, service, node))),
            self._nodes.was_good(service.topic, node),
            service.gated,
        )
        verdict = decide(case)
        if service.policy is Policy.ADVISE:
            why = waiting or "the policy is advise"
            return Verdict(False, f"nothing is done, as {why}; else {verdict.why}")
        return verdict

    def _never(self, planner: Planner, failed: Service, node: str) -> str:
        """Why a node is not to be killed for what is said of a service that is not its own."""
        if self._names.of_healing(node, in_som=node == failed.node):
            return "it belongs to healing or to ROS"
        if node == failed.node:
            return ""
        for service, row in self._published(planner, node):
            own = service.needed and service.node == node and row.state is PublisherState.HEALTHY
            if own and service.name != failed.name:
                return f"the SOM names it for {service.topic}, which is needed and good"
        return ""

    def awaited(self, service: Service, node: str) -> bool:
        """Whether a node that comes back may bring another service that nothing else gives."""
        stuck = self._concern.stuck
        return any(each in stuck for each in self._concern.blaming(node) if each != service.name)

    def _costs(self, planner: Planner, failed: Service, node: str) -> Set[str]:
        """The needed topics that would be lost with a node."""
        others = (self._kills.nodes | self._nodes.excluded) - {node}
        doomed = others | {node}
        lost: Set[str] = set()
        for service, row in self._published(planner, node):
            if service.needed and service.name != failed.name and _may_speak(row):
                if not self._remains(planner, service, doomed):
                    lost.add(service.topic)
            if row.state is PublisherState.HEALTHY:
                lost.update(self._relying(planner, service, doomed))
        # What goes with a node that is being killed was to be replaced, perhaps by this one.
        for other in sorted(others):
            for service, row in self._published(planner, other):
                promised = service.needed and row.state is PublisherState.HEALTHY
                if promised and not self._remains(planner, service, doomed):
                    if self._remains(planner, service, others):
                        lost.add(service.topic)
        return lost

    def _useful(self, planner: Planner, failed: Service, node: str) -> List[str]:
        return [
            service.topic
            for service, row in self._published(planner, node)
            if service.name != failed.name and row.state is PublisherState.HEALTHY
        ]

    def _published(self, planner: Planner, node: str) -> Iterator[Tuple[Service, PublisherHealth]]:
        for topic in self._nodes.topics(node):
            service = planner.som.service_of(topic, node)
            if service is not None:
                yield service, self._nodes.health(topic)[node]

    def _remains(self, planner: Planner, service: Service, doomed: FrozenSet[str]) -> bool:
        """Whether a service has good data without some nodes."""
        for row in self._nodes.health(service.topic).values():
            if row.state is PublisherState.HEALTHY and row.publisher not in doomed:
                if row.publisher not in self._nodes.substitutes:
                    return True
        return planner.replaceable(service, doomed)

    def _relying(self, planner: Planner, service: Service, doomed: FrozenSet[str]) -> Iterator[str]:
        """The topics that a substitute computes from a service, and that nothing else gives."""
        for name in self._concern.readers([service.name]):
            healing = self._healings[name]
            read = planner.som.services.get(name)
            if read is None or healing.incident is None or healing.state not in COMPUTED:
                continue
            without = doomed | {healing.incident.faulty_node}
            if not planner.replaceable(read, without, healing.substitute.tried):
                yield read.topic


def _may_speak(row: PublisherHealth) -> bool:
    """Whether good data comes from a publisher, or would come when it wakes."""
    awake = row.kind in QUIET and row.kind is not Kind.NODE_GONE
    return row.state is not PublisherState.FAILED or awake

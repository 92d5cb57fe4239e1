"""Learns which process a node is while it is healthy, once each time that it comes up."""
from typing import Dict, List, Tuple

from shsa_core.agenda import Agenda
from shsa_core.healing.events import Command, LearnNode, NodeLearned
from shsa_core.healing.robot import Robot


class Identities:
    """The processes of nodes, which `Health.verified` and `Health.protected` tell of."""

    def __init__(self, robot: Robot) -> None:
        self.agenda: Agenda[str] = Agenda()  # nodes that are to be looked at again
        self._health = robot.health
        self._settings = robot.settings
        self._tries: Dict[str, Tuple[int, str]] = {}  # and the topic by which they are learned

    def came_up(self, node: str, topic: str) -> List[Command]:
        """Learn a node that is healthy on a topic, unless it is known."""
        if node in self._tries:
            return []
        self._tries[node] = 0, topic
        return [LearnNode(node, topic)]

    def learned(self, event: NodeLearned) -> None:
        """Note what was learned; the next try follows after a pause if it failed."""
        node, protected = event.node, self._health.protected
        if not event.known and node in self._tries:
            tries, topic = self._tries[node]
            self._tries[node] = tries + 1, topic
            self.agenda.set(node, event.time + self._settings.paused(tries))
        if event.known:
            self._health.verified.add(node)
            startable = self._health.startable
            (startable.add if event.starts else startable.discard)(node)
            protected.pop(node, None)
        if event.protected:
            protected[node] = event.protected

    def went(self, node: str) -> None:
        """Forget which process a node is: what comes up under its name is another one."""
        if self._tries.pop(node, None) is not None:
            self.agenda.set(node, None)
        else:  # nobody will learn it anew
            self._health.protected.pop(node, None)

    def due(self, time: float) -> List[Command]:
        """Return the looks that are due."""
        return [LearnNode(node, self._tries[node][1]) for node in self.agenda.pop_due(time)]

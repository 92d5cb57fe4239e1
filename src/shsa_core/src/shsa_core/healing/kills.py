"""How a faulty node is killed: asked first, then its process ended; and what counts as certain."""
from dataclasses import dataclass
from typing import Dict, FrozenSet, List, Optional, Tuple

from shsa_core.agenda import Agenda
from shsa_core.healing.events import (
    AskToLeave,
    ClearNode,
    Command,
    EndProcess,
    FindNode,
    NodeFound,
    NodeLeft,
    ProcessUntouchable,
    Where,
)

FIND_TIMEOUT_S = 2.0
EXIT_TIMEOUT_S = 1.0


@dataclass(frozen=True)
class KillNode:
    """Kill a node for certain. `urgent`: it may still publish."""

    node: str
    urgent: bool


@dataclass(frozen=True)
class NodeKilled:
    """The kill of a node is over: it is gone for certain, or could not be reached to make sure.

    It was gone at `time`, which is when the kill began if it was dead already.
    """

    time: float
    node: str
    certain: bool
    detail: str


@dataclass
class _Kill:
    begun: float
    urgent: bool
    where: Optional[Where] = None
    forced: bool = False


class Kills:
    """The kills that are under way.

    `patience`: how long in s an urgent node may take to leave after `rosnode kill` before its
    process is ended; any other gets EXIT_TIMEOUT_S. A node that is stopped is not asked, and one on
    another computer is only asked.
    """

    def __init__(self, patience: float) -> None:
        self.nodes: FrozenSet[str] = frozenset()
        self._patience = patience
        self._kills: Dict[str, _Kill] = {}
        self._agenda: Agenda[str] = Agenda()

    @property
    def deadline(self) -> Optional[float]:
        """When `tick` has something to do, in s; None: nothing is due."""
        return self._agenda.next()

    def begin(self, time: float, kill: KillNode) -> List[Command]:
        """Kill a node; nothing is done if that is under way."""
        if not kill.node or kill.node in self._kills:
            return []
        self._kills[kill.node] = _Kill(time, kill.urgent)
        self.nodes = frozenset(self._kills)
        self._agenda.set(kill.node, time + FIND_TIMEOUT_S)
        return [FindNode(kill.node, successor=kill.urgent)]

    def found(self, event: NodeFound) -> Tuple[List[Command], Optional[NodeKilled]]:
        """It is known where the process of a node runs."""
        kill, node, time = self._kills.get(event.node), event.node, event.time
        if kill is None or kill.where is not None:
            return [], None
        kill.where = event.where
        if event.where in (Where.NOWHERE, Where.DEAD):
            time = kill.begun  # whoever is well since then is another process
        if event.where is Where.NOWHERE:
            return [], self._over(time, node, True, "it is not registered")
        if event.where is Where.DEAD:
            return [ClearNode(node)], self._over(time, node, True, "it had died")
        if event.where is Where.STOPPED:
            return self._force(time, node, kill), None
        in_a_hurry = event.where is Where.HERE and kill.urgent
        self._agenda.set(node, time + (self._patience if in_a_hurry else EXIT_TIMEOUT_S))
        return [AskToLeave(node)], None

    def left(self, event: NodeLeft) -> Tuple[List[Command], Optional[NodeKilled]]:
        """The process of a node has ended, or it answered from another computer."""
        kill = self._kills.get(event.node)
        if kill is None:
            return [], None
        how = "it did not leave in time, its process was killed" if kill.forced else "it left"
        return [ClearNode(event.node)], self._over(event.time, event.node, True, how)

    def untouchable(self, event: ProcessUntouchable) -> Optional[NodeKilled]:
        """The process of a node belongs to somebody else."""
        if event.node not in self._kills:
            return None
        why = "it does not leave, and its process belongs to somebody else"
        return self._over(event.time, event.node, False, why)

    def tick(self, time: float) -> Tuple[List[Command], List[NodeKilled]]:
        """Time passed: who was asked in vain is forced, who was forced in vain is given up."""
        commands: List[Command] = []
        over: List[NodeKilled] = []
        for node in self._agenda.pop_due(time):
            kill = self._kills[node]
            if kill.where is Where.HERE and not kill.forced:
                commands += self._force(time, node, kill)
                continue
            why = "its process does not end"
            if kill.where is None:
                why = "it could not be found in time"
            elif kill.where is Where.ELSEWHERE:
                why = "it runs on another computer and does not answer"
            over.append(self._over(time, node, False, why))
        return commands, over

    def _force(self, time: float, node: str, kill: _Kill) -> List[Command]:
        kill.forced = True
        self._agenda.set(node, time + EXIT_TIMEOUT_S)
        return [EndProcess(node)]

    def _over(self, time: float, node: str, certain: bool, detail: str) -> NodeKilled:
        del self._kills[node]
        self.nodes = frozenset(self._kills)
        self._agenda.set(node, None)
        return NodeKilled(time, node, certain, detail)

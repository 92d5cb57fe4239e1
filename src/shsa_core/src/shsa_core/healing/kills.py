"""How a faulty node is killed: asked first, then its process ended; and what counts as certain."""
from dataclasses import dataclass, field
from typing import Dict, FrozenSet, List, Optional, Tuple, Union

from shsa_core.agenda import Agenda, doubled
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
from shsa_core.healing.sent_there import SentThere

FIND_TIMEOUT_S = 2.0
EXIT_TIMEOUT_S = 1.0
AGAIN_S = 2.0
"""The pause before a kill that failed here is tried again; it doubles."""
LONGEST_AGAIN_S = 60.0
LISTEN_S = 0.5
LISTEN_PERIODS = 3.0
"""What a node sends on its own computer is counted for so long, whichever is more."""


@dataclass(frozen=True)
class KillNode:
    """Kill a node for certain.

    `urgent`: it may still publish. `if_dead`: only clear what it left if it is dead, else spare it.
    `topic`: what it failed on; who does not publish that is spared. Empty: a substitute of ours.
    `at_once`: it is not asked to leave first, as it has only just come up. `only_here`: one on
    another computer is left alone. `period`: its failure may be one of the link to its computer, so
    that it is spared if it sends `topic` about every so many s there; 0: its failure is its own.
    """

    node: str
    urgent: bool
    if_dead: bool = False
    topic: str = ""
    at_once: bool = False
    only_here: bool = False
    period: float = 0.0


@dataclass(frozen=True)
class NodeKilled:
    """The kill of a node is over: it is gone for certain, or could not be reached to make sure.

    It was gone at `time`, which is when the kill began if it was dead already. `starter`: who had
    started it, empty: not known.
    """

    time: float
    node: str
    certain: bool
    detail: str
    starter: str = ""


@dataclass(frozen=True)
class NodeSpared:
    """A node that was to be cleared if it is dead may still run.

    `detail`: why one that was to be killed is not touched: it is not the one that failed.
    """

    time: float
    node: str
    detail: str = ""


@dataclass(frozen=True)
class NodeUnreached:
    """Nothing can be said of a node that was to be killed: its computer was lost."""

    time: float
    node: str
    detail: str


@dataclass(frozen=True)
class NodeSends:
    """A node that was to be killed may do well: what its own computer says of it, and the cause."""

    time: float
    node: str
    detail: str
    cause: str


Over = Union[NodeKilled, NodeSpared, NodeUnreached, NodeSends]


@dataclass
class _Kill:
    begun: float
    urgent: bool
    if_dead: bool = False
    at_once: bool = False
    only_here: bool = False
    period: float = 0.0
    where: Optional[Where] = None
    forced: bool = False
    topics: Dict[str, bool] = field(default_factory=dict)  # what it failed on, and if looked at
    starter: str = ""

    @property
    def listen(self) -> float:
        """For how long its node is listened to on its own computer, in s."""
        return max(LISTEN_S, LISTEN_PERIODS * self.period) if self.period else 0.0


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
        self._again: Agenda[str] = Agenda()
        self._tries: Dict[str, int] = {}
        self._sent_there = SentThere()

    @property
    def deadline(self) -> Optional[float]:
        """When `tick` or `again` has something to do, in s; None: nothing is due."""
        dues = (self._agenda.next(), self._again.next())
        return min((due for due in dues if due is not None), default=None)

    def again(self, time: float) -> List[str]:
        """The nodes that could not be killed before, as this computer had no means to."""
        return self._again.pop_due(time)

    def begin(self, time: float, kill: KillNode) -> List[Command]:
        """Kill a node; nothing is done if that is under way, but it may be spared no more."""
        under_way = self._kills.get(kill.node)
        if under_way is not None:
            under_way.if_dead = under_way.if_dead and kill.if_dead
            under_way.only_here = under_way.only_here and kill.only_here
            under_way.period = under_way.period if kill.period else 0.0
            under_way.topics.setdefault(kill.topic, False)
        if not kill.node or under_way is not None:
            return []
        self._kills[kill.node] = _Kill(
            *(time, kill.urgent, kill.if_dead, kill.at_once, kill.only_here, kill.period),
            topics={kill.topic: True},
        )
        self.nodes = frozenset(self._kills)
        self._again.set(kill.node, None)
        return [self._find(time, kill.node, kill.topic)]

    def found(
        self, event: NodeFound, strained: bool = False
    ) -> Tuple[List[Command], Optional[Over]]:
        """It is known where the process of a node runs; `strained`: much is to be done there."""
        kill, node, time = self._kills.get(event.node), event.node, event.time
        if kill is None or kill.where is not None:
            return [], None
        untold = [topic for topic, looked in kill.topics.items() if not looked]
        if event.where is Where.ANOTHER and untold:
            kill.topics[untold[0]] = True
            return [self._find(time, node, untold[0])], None
        kill.where, kill.starter = event.where, event.starter
        if event.where in (Where.NOWHERE, Where.DEAD):
            time = kill.begun  # whoever is well since then is another process
        if event.where is Where.NOWHERE:
            return [], self._over(time, node, True, "it is not registered")
        if event.where is Where.DEAD:
            return [ClearNode(node)], self._over(time, node, True, "it had died")
        if event.where is Where.ANOTHER:
            why = event.detail or "it is not the one that failed"
            return [], self._spare(time, node, "" if kill.if_dead or kill.at_once else why)
        if kill.if_dead:
            return [], self._spare(time, node)
        if event.where is Where.UNREACHABLE:
            return [], self.unreached(time, node, event.detail or "its computer cannot be reached")
        if event.where is Where.UNKNOWN and kill.period:
            return [], self.unreached(time, node, event.detail or "nothing can be verified there")
        if event.where is Where.UNKNOWN:
            why = event.detail or "it cannot be verified which process it is"
            return [], self._over(time, node, False, why)
        if kill.period and event.where is Where.HERE:
            doubt = self._sent_there.doubt(time, node, event.rate, kill.period, strained)
            if doubt is not None:
                self._end(node)
                return [], NodeSends(time, node, *doubt)
        if event.where is Where.STOPPED or (kill.at_once and event.where is Where.HERE):
            return self._force(time, node, kill), None
        if kill.period and event.where is Where.ELSEWHERE and not kill.only_here:
            return [], self.unreached(time, node, "no agent says how it does on its computer")
        if kill.only_here and event.where is Where.ELSEWHERE:
            # The link may be down: a hung node would not answer, and a sound one must not hear it.
            why = "it is silent on another computer, and left alone there"
            return [], self._over(time, node, False, why)
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

    def untouchable(self, event: ProcessUntouchable) -> Optional[Over]:
        """The process of a node cannot be ended."""
        kill = self._kills.get(event.node)
        if kill is None:
            return None
        if kill.if_dead:
            return self._spare(event.time, event.node)
        why = event.detail or "it does not leave, and its process belongs to somebody else"
        return self._over(event.time, event.node, False, why)

    def unreached(self, time: float, node: str, detail: str) -> Over:
        """The computer of a node that is being killed was lost, or does not answer in time."""
        if self._kills[node].if_dead:
            return self._spare(time, node)
        self._end(node)
        return NodeUnreached(time, node, detail)

    def tick(self, time: float) -> Tuple[List[Command], List[Over]]:
        """Time passed: who was asked in vain is forced, who was forced in vain is given up."""
        commands: List[Command] = []
        over: List[Over] = []
        for node in self._agenda.pop_due(time):
            kill = self._kills[node]
            if kill.where is Where.HERE and not kill.forced:
                commands += self._force(time, node, kill)
                continue
            if kill.if_dead:
                over.append(self._spare(time, node))
                continue
            if kill.where is None and kill.period:
                over.append(self.unreached(time, node, "its computer does not say how it does"))
                continue
            why = "its process does not end"
            if kill.where is None:
                why = "it could not be found in time"
            elif kill.where is Where.ELSEWHERE:
                why = "it runs on another computer and does not answer"
            if kill.where is not Where.ELSEWHERE:
                tries = self._tries.get(node, 0)
                self._tries[node] = tries + 1
                self._again.set(node, time + doubled(AGAIN_S, tries, LONGEST_AGAIN_S))
            over.append(self._over(time, node, False, why))
        return commands, over

    def _find(self, time: float, node: str, topic: str) -> FindNode:
        kill = self._kills[node]
        self._agenda.set(node, time + FIND_TIMEOUT_S + kill.listen)
        return FindNode(node, kill.urgent, topic, kill.listen)

    def _force(self, time: float, node: str, kill: _Kill) -> List[Command]:
        kill.forced = True
        self._agenda.set(node, time + EXIT_TIMEOUT_S)
        return [EndProcess(node)]

    def _over(self, time: float, node: str, certain: bool, detail: str) -> NodeKilled:
        starter = self._kills[node].starter
        self._end(node)
        if certain:
            self._tries.pop(node, None)
        return NodeKilled(time, node, certain, detail, starter)

    def _spare(self, time: float, node: str, detail: str = "") -> NodeSpared:
        self._end(node)
        return NodeSpared(time, node, detail)

    def _end(self, node: str) -> None:
        del self._kills[node]
        self.nodes = frozenset(self._kills)
        self._agenda.set(node, None)

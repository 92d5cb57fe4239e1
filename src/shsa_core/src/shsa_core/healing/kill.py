"""Ends a node: asks it first, then ends its process; and says what is certain of that."""
from dataclasses import dataclass, field, replace
from math import inf
from typing import Dict, List, Optional, Tuple, Union

from shsa_core.agenda import Agenda
from shsa_core.healing import events, settings as limits
from shsa_core.healing.events import Command, NodeFound, Where
from shsa_core.healing.robot import Robot
from shsa_core.model.checks import RateHigh, RateLow
from shsa_core.model.kinds import Word
from shsa_core.planning.settings import CERTAIN_S

USUAL = RateLow.usual, RateHigh.usual
"""Of its usual rate: a node that sends about that much on its own computer does well there."""
LINK = "so it is its link that fails"


@dataclass(frozen=True)
class KillNode:
    """Kill a node for certain.

    `if_dead`: only clear what it left if it is dead, else spare it.
    `topic`: what it failed on; a node that does not publish that is spared. Empty: a substitute of
    ours. `at_once`: it is not asked to leave first, as it has only just come up. `only_here`: one
    on another computer is left alone. `period`: its failure may be one of the link to its computer,
    so that it is spared if it sends `topic` about every so many s there; 0: its failure is its own.
    `quick`: it gets no time to shut down in order.
    """

    node: str
    topic: str = ""
    if_dead: bool = False
    at_once: bool = False
    only_here: bool = False
    period: float = 0.0
    quick: bool = False


class Outcome(Word):
    """The end of a kill, as it is told of the node."""

    GONE = "is gone"  # for certain
    UNSURE = "may still be running"  # it could not be reached to make sure
    SPARED = "is spared"  # it was to be cleared if it is dead
    ANOTHER = "is left alone"  # it is not the one that failed
    PROTECTED = "is kept"  # it is ended only where the SOM says so
    UNREACHED = "may still run"  # its computer was lost
    WELL = "is not killed"  # it may do well, as its own computer tells


@dataclass(frozen=True)
class KillOver:
    """The kill of a node is over; it was gone at `time`: when the kill began if it was dead.

    `detail`: what was seen; `cause`: why it may do well all the same. `starter`: who had started
    it, empty: not known. `failing`: the topics on which its next life has failed meanwhile.
    `news`: it is to be told.
    """

    time: float
    node: str
    outcome: Outcome
    detail: str = ""
    cause: str = ""
    starter: str = ""
    failing: Tuple[str, ...] = ()
    news: bool = True

    @property
    def told(self) -> str:
        """Return how the kill ended, in words."""
        return f"{self.node} {self.outcome}: {', '.join(filter(None, (self.detail, self.cause)))}"


KillEvent = Union[NodeFound, events.NodeAnswered, events.NodeLeft, events.ProcessUntouchable]
KILL_EVENTS = (NodeFound, events.NodeAnswered, events.NodeLeft, events.ProcessUntouchable)
Said = Union[Command, KillOver]


@dataclass
class _Kill:
    """The kill of a node; `topics`: what it failed on, and whether it was looked at for that."""

    begun: float
    order: KillNode
    topics: Dict[str, bool] = field(default_factory=dict)
    where: Optional[Where] = None
    answered: bool = False
    forced: bool = False
    starter: str = ""


class Kills:
    """The kills that are under way; those are `Health.dying`.

    A node is asked to leave. One that answers has the time that roslaunch gives, so that its
    shutdown handler can stop the motors; one that does not, or whose kill is quick, is ended at
    once. A node that is stopped is not asked, and one on another computer is only asked.
    """

    def __init__(self, robot: Robot) -> None:
        self.agenda: Agenda[str] = Agenda()
        self.again: Agenda[str] = Agenda()
        self._robot = robot
        self._health = robot.health
        self._kills: Dict[str, _Kill] = {}
        self._tries: Dict[str, int] = {}
        self._slow: Dict[str, float] = {}  # there: since when at each look

    def under_way(self, node: str) -> bool:
        """Tell that a node is being killed, or that its kill waits."""
        return node in self._kills or self.again.when(node) < inf

    def order(self, order: KillNode) -> List[Command]:
        """Begin a kill, or let it wait: a silence must last beside the node's computer."""
        robot, node = self._robot, order.node
        host = robot.host_of(node) if robot.som.hosts else ""
        waits = order.only_here and (host or not order.quick)
        if waits and robot.computers.reachable(host):
            self.wait(node, order.period)
            return []
        return self.begin(robot.time, order if host else replace(order, period=0.0))  # no link

    def wait(self, node: str, period: float = 0.0) -> None:
        """Kill a node later, once its computer was heard beside it, and it could be heard twice."""
        self.again.set(node, self._robot.time + max(CERTAIN_S, 2.0 * period))

    def try_again(self, node: str) -> None:
        """Look for a node later, after pauses that grow while that is in vain."""
        tries = self._tries[node] = self._tries.get(node, -1) + 1
        self.again.set(node, self._robot.time + self._robot.settings.paused(tries))

    def forget(self, node: str) -> None:
        """Kill a node no more, if that waits."""
        self.again.set(node, None)
        self._slow.pop(node, None)
        self._tries.pop(node, None)

    def due(self) -> List[str]:
        """Return the nodes to kill again; those wait on whose computers are not heard for long."""
        robot, found = self._robot, []
        for node in self.again.pop_due(robot.time):
            host = robot.host_of(node)
            heard = robot.time - robot.computers.of(host).steady >= CERTAIN_S
            if host and not (robot.computers.reachable(host) and heard):
                self.wait(node)
            else:
                found.append(node)
        return found

    def begin(self, time: float, order: KillNode) -> List[Command]:
        """Kill a node; nothing is done if that is under way, but it may be spared no more.

        Its next life is judged once that is over.
        """
        kill, node = self._kills.get(order.node), order.node
        if kill and not self._health.fails_anew((order.topic, node), kill.begun):
            former = kill.order
            kill.order = replace(
                former,
                if_dead=former.if_dead and order.if_dead,
                only_here=former.only_here and order.only_here,
                period=former.period if order.period else 0.0,
                quick=former.quick or order.quick,
            )
            kill.topics.setdefault(order.topic, False)
        if not node or kill is not None:
            return []
        row = self._health.rows.get(order.topic, {}).get(node)
        self._kills[node] = _Kill(time, order, {order.topic: True})
        self._health.dying[node] = row.uri if row else ""
        self.again.set(node, None)
        return [self._find(time, node, order.topic)]

    def handle(self, event: KillEvent, speaks: bool = False, refused: bool = False) -> List[Said]:
        """Go on with the kill of one that `speaks` again; `refused`: it is ended as it comes up."""
        kill, time, node = self._kills.get(event.node), event.time, event.node
        if kill is None or event.uri != self._health.dying[node]:  # it is late: of another life
            return []
        if isinstance(event, NodeFound):
            return [] if kill.where is not None else self._found(event, kill, speaks, refused)
        if isinstance(event, events.NodeAnswered):
            if not (kill.order.quick or kill.forced):
                kill.answered = True
                self.agenda.set(node, time + limits.LEAVE_S)
            return []
        if isinstance(event, events.NodeLeft):
            how = "it did not leave in time, its process was killed" if kill.forced else "it left"
            return [*self._over(time, node, True, how), events.ClearNode(node)]
        why = event.detail or "it does not leave, and its process belongs to somebody else"
        return self._over(time, node, False, why)

    def tick(self, time: float) -> List[Said]:
        """Force a node that was asked in vain, and give up one that was forced in vain."""
        said: List[Said] = []
        for node in self.agenda.pop_due(time):
            kill = self._kills[node]
            if kill.where is Where.HERE and not kill.forced:
                said += self._force(time, node, kill)
            elif kill.where is None and kill.order.period:
                said += self.unreached(time, node, "its computer does not say how it does")
            else:
                ends = "it does not end" if kill.answered or kill.forced else "it does not answer"
                why = "it could not be found in time" if kill.where is None else ends
                if not kill.order.if_dead:
                    self.try_again(node)
                said += self._over(time, node, False, why)
        return said

    def unreached(self, time: float, node: str, detail: str) -> List[Said]:
        """End a kill as the node's computer was lost, or does not answer in time."""
        self._slow.pop(node, None)
        if self._kills[node].order.if_dead or not self._robot.host_of(node):
            return self._over(time, node, False, detail)
        return self._end(time, node, Outcome.UNREACHED, detail)

    def _found(self, event: NodeFound, kill: _Kill, speaks: bool, refused: bool) -> List[Said]:
        """Act on where the process of a node runs: the first rule that applies counts."""
        time, node, where, order = event.time, event.node, event.where, kill.order
        untold = [topic for topic, looked in kill.topics.items() if not looked]
        if where is Where.ANOTHER and untold:
            kill.topics[untold[0]] = True
            return [self._find(time, node, untold[0])]
        kill.where, kill.starter = where, event.starter
        if where is Where.NOWHERE:  # who is well since the kill began is another process
            return self._over(kill.begun, node, True, "it is not registered")
        if where is Where.DEAD:
            return [*self._over(kill.begun, node, True, "it had died"), events.ClearNode(node)]
        if where in (Where.ANOTHER, Where.PROTECTED):
            why, left = event.detail or "it is not the one that failed", Outcome.ANOTHER
            if where is Where.PROTECTED:
                self._health.protected[node], left = why, Outcome.PROTECTED
            spared = order.if_dead or order.at_once
            return self._end(time, node, Outcome.SPARED if spared else left, why)
        speaks &= not self._health.succeeded(node)  # else it is another life that speaks
        if order.if_dead or (not refused if order.at_once else speaks):
            return self._end(time, node, Outcome.SPARED)
        if where is Where.UNREACHABLE or (where is Where.UNKNOWN and order.period):
            return self.unreached(time, node, event.detail)
        if where is Where.UNKNOWN:
            return self._over(time, node, False, event.detail)
        if where is Where.HERE and order.period:
            doubt = self.doubt(event, order.period)
            if doubt is not None:
                return self._end(time, node, Outcome.WELL, *doubt)
        if where is Where.STOPPED or (order.at_once and where is Where.HERE):
            return list(self._force(time, node, kill))
        if where is Where.ELSEWHERE and (order.period or order.only_here):
            # The link may be down: a hung node would not answer, and a sound one must not hear it.
            return self.unreached(time, node, "no agent says how it does on its computer")
        quick = where is Where.HERE and order.quick
        patience = self._robot.settings.kill_patience if quick else limits.EXIT_TIMEOUT_S
        self.agenda.set(node, time + patience)
        return [events.AskToLeave(node, self._health.dying[node])]

    def doubt(self, event: NodeFound, period: float) -> Optional[Tuple[str, str]]:
        """Return why a node may not fail by itself, though it fails here: what was seen, and why.

        None: it fails by itself. A link makes nobody silent, or quick, on his own computer. Slow
        there is a well node as well while its computer is strained, and for a moment at any time.
        `period`: that of its messages by the SOM, in s.
        """
        time, node, rate = event.time, event.node, event.rate
        began = self._slow.pop(node, time)
        if rate is None:
            return "nobody is connected to it on its own computer", LINK
        seen = f"on its own computer it sends {rate:.0f} messages/s"
        if rate == 0.0 or rate * period > USUAL[1]:
            return None
        if rate * period >= USUAL[0]:
            return seen, LINK
        if self._robot.computers.strained(self._robot.host_of(node)):
            return seen, "and its computer has too much to do"
        if time - began >= 2.0 * CERTAIN_S:  # so did two more looks
            return None
        self._slow[node] = began
        return seen, "and that may pass"

    def _find(self, time: float, node: str, topic: str) -> events.FindNode:
        order = self._kills[node].order
        listen = max(limits.LISTEN_S, limits.LISTEN_PERIODS * order.period) if order.period else 0.0
        self.agenda.set(node, time + limits.FIND_TIMEOUT_S + listen)
        urgent, spares = not order.if_dead, not order.quick
        return events.FindNode(node, urgent, topic, listen, self._health.dying[node], spares)

    def _force(self, time: float, node: str, kill: _Kill) -> List[Command]:
        gently, kill.answered = kill.answered, False
        kill.forced = not gently
        self.agenda.set(node, time + (limits.TERM_S if gently else limits.EXIT_TIMEOUT_S))
        return [events.EndProcess(node, self._health.dying[node], gently)]

    def _over(self, time: float, node: str, certain: bool, detail: str) -> List[Said]:
        """End a kill; one that was to be cleared if it is dead is spared if that is not certain."""
        kill = self._kills[node]
        time = kill.begun if self._health.succeeded(node) else time
        if certain:
            self._tries.pop(node, None)
        elif kill.order.if_dead:
            return self._end(time, node, Outcome.SPARED)
        return self._end(time, node, Outcome.GONE if certain else Outcome.UNSURE, detail)

    def _end(
        self, time: float, node: str, outcome: Outcome, detail: str = "", cause: str = ""
    ) -> List[Said]:
        kill, health = self._kills.pop(node), self._health
        failing = [e.topic for e in health.of_node(node) if health.fails_anew(e.key, kill.begun)]
        del health.dying[node]
        self.agenda.set(node, None)
        return [KillOver(time, node, outcome, detail, cause, kill.starter, tuple(failing))]

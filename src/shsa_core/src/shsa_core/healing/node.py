"""One case a node, whoever accuses it: what becomes of it, and its way back.

Every accusation comes from one service. This is the one place that decides whether a node is killed
or kept; how it is killed is in `kill`. A kill that must wait for a computer is begun once that is
heard. A node that is gone is started again by its policy, after pauses that double, and no more
when it failed too often. Whoever starts it, its hold-off doubles each time that it relapses; then
it is kept out. A relapse that may be its link's makes the hold-off longer, and keeps nobody out.
"""
import math
from dataclasses import dataclass, field, replace
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Union

from shsa_core.agenda import Agenda, doubled
from shsa_core.healing import events
from shsa_core.healing.containment import Stakes, Verdict, decide
from shsa_core.healing.events import Command, Level, Log
from shsa_core.healing.health import Health
from shsa_core.healing.hosts import Computers
from shsa_core.healing.kill import (
    KillNode,
    KillOutcome,
    Kills,
    NodeAlive,
    NodeKilled,
    NodeSpared,
    NodeUnreached,
)
from shsa_core.healing.records import Fate, NodeRecord, Record, Trust
from shsa_core.healing.settings import CERTAIN_S, LEARN_PAUSES_S, ORPHAN_KILLS, Settings
from shsa_core.healing.tables import Table
from shsa_core.model.kinds import BY_LINK, QUIET, Contain, Kind, Policy
from shsa_core.model.service import Service

UNTRIED = Trust()


@dataclass(frozen=True)
class RestartVain:
    """A node could not be started again."""

    time: float
    node: str
    detail: str


@dataclass(frozen=True)
class TrustChanged:
    """It was not the node's own failure: whoever accuses it shows that it is not kept out."""

    time: float
    node: str


NodeEvent = Union[KillOutcome, RestartVain, TrustChanged]
NODE_EVENTS = (NodeKilled, NodeSpared, NodeUnreached, NodeAlive, RestartVain, TrustChanged)
Said = Union[Command, NodeEvent]


@dataclass
class Accusation:
    """A node failed on the topic of a service.

    `decision` says in words what becomes of it. `heard`: it may publish, so that nobody else
    should. `excuse`: what else may be the cause, as its own computer tells; empty: not known.
    """

    node: str
    kind: Kind
    fate: Fate = Fate.OPEN
    heard: bool = True
    decision: str = ""
    excuse: str = ""
    asks_there: bool = False  # its own computer is asked before it is killed
    back: bool = False  # it publishes again

    @property
    def kept(self) -> bool:
        """Tell that the node is not killed, for the time being."""
        return self.fate is Fate.KEPT

    @property
    def babbles(self) -> bool:
        """Tell that it is kept although consumers hear what is wrong of it."""
        return self.kept and self.heard

    @property
    def silent(self) -> bool:
        """Tell that the node is silent, as one is whose computer is cut off."""
        return self.kind in QUIET and self.kind is not Kind.NODE_GONE


@dataclass
class Case:
    """What is held against a node, by service, and how far it is trusted.

    `before`: the trust before its last failure. `failing`: since that it was not back. `refusals`:
    how often it was killed as it came back while it is kept out.
    """

    accusations: Dict[str, Accusation] = field(default_factory=dict)
    trust: Trust = UNTRIED
    before: Trust = UNTRIED
    failed_at: float = -math.inf
    failing: bool = False
    refusals: int = 0
    told: int = 0
    tell_at: float = -math.inf


class _Pending(NamedTuple):
    """A kill that waits for a computer; `silent`: until that was heard beside the silence."""

    host: str
    since: float
    silent: bool


class Nodes:
    """The cases of all nodes.

    `spec`: a service as it counts now, by its name. `host_of`: the computer that a node runs on.
    `restarted`: the nodes that were started again, and whether whoever ends us has started them
    first.
    """

    def __init__(
        self,
        settings: Settings,
        health: Health,
        stakes: Stakes,
        computers: Computers,
        spec: Callable[[str], Optional[Service]],
        host_of: Callable[[str], str],
        records: "Table[Record, events.WriteDown]",
    ) -> None:
        self.kills = Kills(health, settings.kill_patience)
        self.restarted: Dict[str, bool] = {}
        self._settings = settings
        self._health = health
        self._stakes = stakes
        self._computers = computers
        self._spec = spec
        self._host_of = host_of
        self._records = records
        self._cases: Dict[str, Case] = {}
        self._returns: Agenda[str] = Agenda()  # nodes that are to be started, or to come up
        self._pending: Dict[str, _Pending] = {}
        self._orphans: Dict[str, int] = {}  # what was left behind, and how often to try yet
        self._tries: Dict[str, int] = {}  # to learn which process a node is
        self._topics: Dict[str, str] = {}
        self._learning: Agenda[str] = Agenda()

    @property
    def deadline(self) -> Optional[float]:
        """Return when `tick` has something to do, in s; None: nothing is due."""
        agendas = (self.kills.agenda, self.kills.again, self._returns, self._learning)
        dues = [agenda.next() for agenda in agendas]
        return min((due for due in dues if due is not None), default=None)

    def accusers(self, node: str) -> List[str]:
        """Return the services that accuse a node."""
        case = self._cases.get(node)
        return [] if case is None else sorted(case.accusations)

    def busy(self, node: str) -> bool:
        """Tell that something more is to happen to a node."""
        waits = self._returns.when(node) < math.inf
        return waits or node in self._pending or node in self._health.dying

    # A node fails, and is judged.

    def accuse(self, service: str, node: str, kind: Kind) -> Accusation:
        """Accuse a node of a failure on a service, perhaps once more: it is to be judged."""
        accusations = self._cases.setdefault(node, Case()).accusations
        found = accusations.setdefault(service, Accusation(node, kind))
        found.kind, found.fate, found.excuse, found.back = kind, Fate.OPEN, "", False
        found.heard = kind is not Kind.NODE_GONE
        return found

    def take_up(self, service: str, accusation: Accusation) -> None:
        """Go on with what a former reconfigurator held against a node."""
        self._cases.setdefault(accusation.node, Case()).accusations[service] = accusation

    def acquit(self, service: Service, node: str, well_at: Optional[float] = None) -> None:
        """Accuse a node no more; `well_at`: it has outlived its hold-off then."""
        case = self._cases[node]
        del case.accusations[service.name]
        if case.accusations:
            return
        case.failing = False
        self._pending.pop(node, None)
        well = case.trust.well_since if well_at is None else well_at
        self._trust(node, case, start_at=None, awaited_by=None, well_since=well)
        if node != service.node:  # a stranger; there may be any number of them
            self._trust(node, case, **vars(UNTRIED))
            del self._cases[node]

    def judge(
        self,
        time: float,
        service: Service,
        accusation: Accusation,
        replaced: bool,
        taken_over: bool,
        waiting: str,
        parted: bool,
    ) -> List[Command]:
        """Kill a node, or keep it, unless that is decided.

        `replaced`: something could take the service over; `taken_over`: that publishes it already.
        A silent node is not killed before: what its substitute reads may be as silent as it is.
        `waiting`: why nothing is done for the time being. `parted`: a cut may part the substitute
        from us or from the node.
        """
        if accusation.fate in (Fate.NONE, Fate.KILLED):
            return []
        node, gone, was_kept = accusation.node, accusation.kind is Kind.NODE_GONE, accusation.kept
        before = accusation.decision if was_kept else ""
        restarted = service.policy.restarts and node == service.node and self.may_restart(node)
        verdict = self.verdict(service, node, accusation.kind, replaced, restarted, waiting)
        forced = not accusation.silent or service.contain is Contain.NODE
        if verdict.kill and not (taken_over or restarted or forced):
            accusation.decision = f"{node} is killed as soon as its substitute publishes"
            accusation.fate, accusation.heard = Fate.WAITS, False
            return []
        accusation.decision, accusation.asks_there = verdict.why, False
        commands: List[Command] = []
        if verdict.kill:
            accusation.fate = Fate.KILLED
            order = self._order(service, accusation)
            if order.period > 0.0 and node == service.node and self._host_of(node):
                text = f"{node} is killed if it fails on its own computer as well"
                accusation.decision, accusation.asks_there = text, True
            if order.only_here and parted:
                accusation.heard = False  # its kill may wait for its computer, and nobody hears it
            commands += self.kill(time, order)
        else:
            accusation.fate = Fate.KEPT
            accusation.heard = accusation.kind not in QUIET and not service.gated
            if gone and not was_kept and service.policy is not Policy.ADVISE:
                commands += self.kill(time, KillNode(node, False, True, service.topic))
        if accusation.decision != before and not gone:
            commands.append(Log(Level.WARN, f"{service.topic}: {accusation.decision}."))
        return commands

    def verdict(
        self,
        service: Service,
        node: str,
        kind: Kind,
        replaced: bool,
        restarted: bool = False,
        waiting: str = "",
    ) -> Verdict:
        """Decide about a node by all that is at stake."""
        verdict = decide(self._stakes.case(service, node, kind, replaced, restarted))
        if service.policy is not Policy.ADVISE:
            return verdict
        why = waiting or "the policy is advise"
        return Verdict(False, f"nothing is done, as {why}; else {verdict.why}")

    @staticmethod
    def _order(service: Service, accusation: Accusation) -> KillNode:
        """Return the kill of a node; if it is not forced, by the word of its computer alone."""
        node, kind = accusation.node, accusation.kind
        forced = service.contain is Contain.NODE
        silent = accusation.silent and not forced
        period = (service.period or 0.0) if kind in BY_LINK and not forced else 0.0
        urgent = kind is not Kind.NODE_GONE
        return KillNode(node, urgent, topic=service.topic, only_here=silent, period=period)

    def kill(self, time: float, order: KillNode) -> List[Command]:
        """Begin a kill, or let it wait for the computer of the node."""
        host = self._host_of(order.node)
        if host and order.only_here and self._computers.reachable(host):
            self._pending[order.node] = _Pending(host, time, True)
            return []
        self._pending.pop(order.node, None)
        return self.kills.begin(time, order if host else replace(order, period=0.0))  # no link

    # A kill goes on, and is over.

    def heed(
        self, event: Union[events.NodeFound, events.NodeLeft, events.ProcessUntouchable]
    ) -> List[Said]:
        """Go on with a kill."""
        strained = self._computers.strained(self._host_of(event.node))
        return self._outcomes(self.kills.handle(event, strained))

    def tick(self, time: float) -> List[Said]:
        """Let time pass: go on with kills, restarts, and looks which process a node is."""
        said = self._outcomes(self.kills.tick(time))
        for node in self.kills.again.pop_due(time):
            said += self._kill_again(time, node)
        for node in self._returns.pop_due(time):
            said += self._return_due(time, node, self._cases[node])
        for node in self._learning.pop_due(time):
            said.append(events.LearnNode(node, self._topics[node]))
        return said

    def computer_heard(self, time: float, host: str) -> List[Said]:
        """Begin the kills that have waited for a computer."""
        if not self._computers.reachable(host):
            return []
        steady = self._computers.steady_since(host)
        due = [
            node
            for node, each in self._pending.items()
            if each.host == host
            and (not each.silent or time - max(each.since, steady) >= CERTAIN_S)
        ]
        said: List[Said] = []
        for node in due:
            del self._pending[node]
            said += self._kill_again(time, node)
        return said

    def computer_lost(self, time: float, host: str, why: str) -> List[Said]:
        """End the kills on a computer that is lost: they go on when it is back."""
        said: List[Said] = []
        for node in sorted(self._health.dying):
            if self._host_of(node) == host:
                said += self._outcomes(self.kills.unreached(time, node, why))
        return said

    def _kill_again(self, time: float, node: str) -> List[Said]:
        """Kill a node that is still accused, and has not returned."""
        said: List[Said] = []
        for name in self.accusers(node):
            service, accusation = self._spec(name), self._cases[node].accusations[name]
            if service is not None and not accusation.back and not accusation.kept:
                order = self._order(service, accusation)
                said += self.kill(time, replace(order, urgent=True, only_here=False))
        return said

    def _outcomes(self, said: Sequence[Said]) -> List[Said]:
        """Note how kills ended, for all that accuse the node."""
        found: List[Said] = []
        for each in said:
            if isinstance(each, NodeKilled):
                found += self._gone(each)
            elif isinstance(each, NodeSpared):
                found += self._spared(each)
            elif isinstance(each, NodeUnreached):
                found += self._unreached(each)
            elif isinstance(each, NodeAlive):
                found += self._alive(each)
            else:
                found.append(each)
        return found

    def _gone(self, kill: NodeKilled) -> List[Said]:
        """A node is gone, or could not be reached to make sure."""
        time, node, case = kill.time, kill.node, self._cases.get(kill.node)
        said: List[Said] = []
        self._health.gone(node, time)
        self.went(node)
        if node not in self._health.excluded:  # it is back already, as another process
            for topic in sorted(self._health.topics.get(node, ())):
                if self._health.healthy((topic, node)):
                    said += self.came_up(node, topic)
        self.forget_restarted(node)
        if kill.certain:
            self._orphans.pop(node, None)
        elif self._orphans.get(node):
            said += self._kill_orphan(time, node)
        for accusation in case.accusations.values() if case else ():
            self._settle(accusation, kill.certain)
        if kill.certain and case:  # its last failure was its own
            trust = case.trust
            self._trust(node, case, doubtful=min(trust.doubtful, case.before.doubtful))
        elif case:
            self._left_alone(node, case)
        return [kill, *said]

    def _spared(self, kill: NodeSpared) -> List[Said]:
        case = self._cases.get(kill.node)
        for accusation in case.accusations.values() if case else ():
            if kill.detail:
                self._settle(accusation)
            else:  # its connection was lost, but it still runs: it is as good as silent
                accusation.kind = Kind.SILENT
        if not kill.detail:
            return [kill]
        if case:
            self._left_alone(kill.node, case)
        return [Log(Level.ERROR, f"{kill.node} is not touched: {kill.detail}."), kill]

    def _unreached(self, kill: NodeUnreached) -> List[Said]:
        """Finish the kill of a node when its computer is back."""
        host, case = self._host_of(kill.node), self._cases.get(kill.node)
        if not host:
            return self._gone(NodeKilled(kill.time, kill.node, False, kill.detail))
        accusations = list(case.accusations.values()) if case else []
        silent = all(each.silent for each in accusations)
        self._pending[kill.node] = _Pending(host, kill.time, silent)
        for accusation in accusations:
            self._settle(accusation)
        return [kill]

    def _alive(self, kill: NodeAlive) -> List[Said]:
        """Ask the computer of a node again while it is missed here, as it may do well there."""
        case = self._cases.get(kill.node)
        self._pending[kill.node] = _Pending(self._host_of(kill.node), kill.time, True)
        accusations = list(case.accusations.values()) if case else []
        news = any(each.excuse != kill.cause for each in accusations)
        for each in accusations:
            each.decision = f"{kill.node} is not killed: {kill.detail}, {kill.cause}"
            each.fate, each.heard, each.excuse = Fate.NONE, False, kill.cause
        return [kill] if news else []

    @staticmethod
    def _settle(accusation: Accusation, certain: bool = False) -> None:
        """Note that a node is gone, or cannot be reached to make sure."""
        if accusation.kept or (certain and accusation.asks_there):
            accusation.decision = f"{accusation.node} is gone"
        accusation.fate, accusation.heard = Fate.NONE, False

    def _left_alone(self, node: str, case: Case) -> None:
        """Do no more about a node: two of one name would end each other, so it is not restarted."""
        if case.refusals:
            self.trust(node)  # it cannot be kept out, and two publishers are worse than one
        self._trust(node, case, start_at=None, awaited_by=None, exhausted=True)

    def end_orphan(self, time: float, node: str) -> List[Command]:
        """End a substitute that was left behind."""
        self._orphans[node] = ORPHAN_KILLS
        return self._kill_orphan(time, node)

    def _kill_orphan(self, time: float, node: str) -> List[Command]:
        self._orphans[node] -= 1
        return self.kill(time, KillNode(node, urgent=True))

    # The way back.

    def hold_off(self, node: str) -> float:
        """Return how long a node must stay healthy when it returns now, in s."""
        settings, relapses = self._settings, self._cases[node].trust.relapses
        return doubled(settings.hold_off, relapses, settings.longest_hold_off)

    def kept_out(self, node: str) -> bool:
        """Tell that a node relapsed too often in a row to return."""
        trust = self._cases[node].trust
        return 0 < self._settings.switches <= trust.relapses - trust.doubtful

    def restarts(self, node: str) -> int:
        """Return how often a node was started again."""
        return self._cases[node].trust.restarts

    def exhausted(self, node: str) -> bool:
        """Tell that a node is not started again any more."""
        return self._cases[node].trust.exhausted

    def may_restart(self, node: str) -> bool:
        """Tell that a node would be started again if its policy is that."""
        trust = self._cases[node].trust
        used_up = trust.exhausted or trust.restarts >= self._settings.node_restarts
        return not used_up and not self.kept_out(node)

    def awaited(self, node: str) -> bool:
        """Tell that a node is to be started, or to come up."""
        return self._returns.when(node) < math.inf

    def failed(self, time: float, node: str, own: bool, soon: bool) -> None:
        """Count a failure; `own`: not its link's, for certain. `soon`: within its hold-off.

        It counts once until the node is back, whoever tells of it.
        """
        case = self._cases[node]
        if case.failing:
            return
        case.failing, case.failed_at, case.before = True, time, case.trust
        trust, settings = case.trust, self._settings
        if not soon:
            well = trust.well_since
            calm = well is not None and time - well > settings.stable
            restarts = 0 if calm else trust.restarts
            self._trust(node, case, restarts=restarts, exhausted=False)
            within = settings.relapse * settings.hold_off
            if trust.returned is None or time - trust.returned > within:
                self.trust(node)
                return
        doubtful = trust.doubtful + (not own)
        self._trust(node, case, relapses=trust.relapses + 1, doubtful=doubtful, soon=not soon)

    def excuse(self, host: str, heard: float) -> List[Said]:
        """Blame no node for its silence since its computer was heard, which was cut off."""
        said: List[Said] = []
        for node, case in self._cases.items():
            silent = any(each.silent for each in case.accusations.values())
            if silent and case.failed_at >= heard and self._host_of(node) == host:
                former = case.before
                changes = former.relapses, former.doubtful, former.soon
                self._trust(node, case, relapses=changes[0], doubtful=changes[1], soon=changes[2])
                said.append(TrustChanged(heard, node))
        return said

    def left_in_order(self, event: events.NodeUnregistered) -> List[Said]:
        """Forgive a node that was told to leave, by somebody else: that is no failure."""
        case = self._cases.get(event.node, Case())
        gone = any(each.kind is Kind.NODE_GONE for each in case.accusations.values())
        if gone and case.trust.soon:
            self.trust(event.node)
        return [TrustChanged(event.time, event.node)] if gone else []

    def returned(self, time: float, service: str, node: str, since: float) -> None:
        """A node publishes a service again, `since` a moment."""
        case = self._cases[node]
        case.failing = False
        if service in case.accusations:
            case.accusations[service].back = True
        trust, awaited = case.trust, None
        if not all(each.back for each in case.accusations.values()) and self.awaited(node):
            awaited = trust.awaited_by or time + self._settings.restart_timeout
        self._trust(node, case, returned=since, start_at=None, awaited_by=awaited)

    def start_again(self, time: float, node: str) -> None:
        """Start a node that is gone again after a pause, unless it was too often."""
        case, settings = self._cases[node], self._settings
        trust = case.trust
        if trust.start_at is not None:
            return
        if self.kept_out(node) or trust.restarts >= settings.node_restarts:
            self._trust(node, case, exhausted=True, awaited_by=None)
            return
        due = time + doubled(settings.restart_pause, trust.restarts)
        self._trust(node, case, start_at=due, awaited_by=None, restarts=trust.restarts + 1)

    def _return_due(self, time: float, node: str, case: Case) -> List[Said]:
        """Start a node, or end one that did not come up in time."""
        specs = [self._spec(name) for name in case.accusations]
        own = [s for s in specs if s is not None and s.policy.restarts and s.node == node]
        starts = case.trust.start_at is not None
        due = time + self._settings.restart_timeout if starts and own else None
        self._trust(node, case, start_at=None, awaited_by=due)
        if not own:  # the policy is another by now, or the node
            return []
        topics = ", ".join(each.topic for each in own)
        if starts:
            text = f"{topics}: {node} is started again."
            return [Log(Level.INFO, text), events.RestartNode(node)]
        text = f"{topics}: {node} did not come back in time."
        order = KillNode(node, True, topic=own[0].topic)
        return [Log(Level.WARN, text), *self.kill(time, order)]

    def trust(self, node: str) -> None:
        """Forget the relapses of a node."""
        case = self._cases[node]
        case.refusals = case.told = 0
        case.tell_at = -math.inf
        self._trust(node, case, relapses=0, doubtful=0, soon=False, returned=None)

    def refuse(self, time: float, order: KillNode) -> List[Command]:
        """Kill a node that is kept out, and has come up."""
        self._cases[order.node].refusals += 1
        return self.kill(time, order)

    def refusals(self, time: float, node: str) -> int:
        """Return how often a node was refused if that is to be told: ever more seldom; else 0."""
        case, settings = self._cases[node], self._settings
        if not case.refusals or time < case.tell_at:
            return 0
        case.tell_at = time + doubled(settings.retry, case.told, settings.retry_limit)
        case.told += 1
        return case.refusals

    def restart_failed(self, event: events.RestartFailed) -> List[Said]:
        """Tell that a node could not be started again."""
        return [RestartVain(event.time, event.node, event.detail)]

    def forget_restarted(self, node: str) -> bool:
        """Note that a node that was started again is gone, or is ended. Returns that it was one."""
        self._records.set(f"restarted {node}", None)
        return self.restarted.pop(node, None) is not None

    def recall(self, record: NodeRecord) -> None:
        """Trust a node as a former reconfigurator did."""
        case = self._cases.setdefault(record.node, Case())
        self._trust(record.node, case, **vars(record.trust))

    def _trust(self, node: str, case: Case, **changes: Any) -> None:
        """Change the trust in a node, and write that down."""
        case.trust = trust = replace(case.trust, **changes)
        record = None if trust == UNTRIED else NodeRecord(node, trust)
        self._records.set(f"node {node}", record)
        due = trust.awaited_by if trust.start_at is None else trust.start_at
        self._returns.set(node, due)

    # Which process a node is: looked at while it is healthy, once each time that it comes up.

    def came_up(self, node: str, topic: str) -> List[Command]:
        """Learn a node that is healthy on a topic, unless it is known."""
        if node in self._tries:
            return []
        self._tries[node] = 0
        self._topics[node] = topic
        return [events.LearnNode(node, topic)]

    def learned(self, event: events.NodeLearned) -> None:
        """Note what was learned; the next try follows after a pause if it failed."""
        health, tries = self._health, self._tries.get(event.node)
        if not event.known and tries is not None:
            self._tries[event.node] = min(tries + 1, len(LEARN_PAUSES_S) - 1)
            self._learning.set(event.node, event.time + LEARN_PAUSES_S[tries])
        if event.known:
            health.verified.add(event.node)
        if event.protected:
            health.protected[event.node] = event.protected
        elif event.known:
            health.protected.pop(event.node, None)

    def went(self, node: str) -> None:
        """Forget which process a node is: what comes up under its name is another one."""
        if self._tries.pop(node, None) is not None:
            self._learning.set(node, None)

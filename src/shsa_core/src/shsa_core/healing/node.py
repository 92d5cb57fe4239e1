"""One case a node, whoever accuses it: what becomes of it, and its way back.

Every accusation comes from one service. This is the one place that decides whether a node is killed
or kept; how it is killed is in `kill`. A kill that must wait for a computer is begun once that is
heard. A node that is gone is started again by its policy, after pauses that double, and no more
when it failed too often. Whoever starts it, its hold-off doubles each time that it relapses; then
it is kept out. A silence that nobody ended, and what may be its link's, make the hold-off longer,
and keep nobody out.
"""
import math
from dataclasses import dataclass, field, replace
from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple, Union

from shsa_core.agenda import Agenda, doubled
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.containment import Stakes, Verdict, decide
from shsa_core.healing.events import Command, Log
from shsa_core.healing.health import MISSED
from shsa_core.healing.kill import KillEvent, KillNode, KillOver, Kills, Outcome
from shsa_core.healing.records import Fate, NodeRecord, Trust
from shsa_core.healing.robot import Robot
from shsa_core.healing.settings import CERTAIN_S, LEARN_PAUSES_S
from shsa_core.model.kinds import BY_LINK, QUIET, Contain, Kind, Policy
from shsa_core.model.log import Level
from shsa_core.model.service import Service

UNTRIED = Trust()


@dataclass(frozen=True)
class TrustChanged:
    """It was not the node's own failure: whoever accuses it shows that it is not kept out."""

    time: float
    node: str


NodeEvent = Union[KillOver, events.RestartFailed, TrustChanged]
NODE_EVENTS = (KillOver, events.RestartFailed, TrustChanged)
Said = Union[Command, NodeEvent]


@dataclass
class Accusation:
    """A node failed on the topic of a service.

    `decision` says in words what becomes of it. `excuse`: what else may be the cause, as its own
    computer tells; empty: not known. `gated`: consumers hear a gate.
    """

    node: str
    kind: Kind
    fate: Fate = Fate.OPEN
    decision: str = ""
    excuse: str = ""
    gated: bool = False
    back: bool = False  # it publishes again

    @property
    def kept(self) -> bool:
        """Tell that the node is not killed, for the time being."""
        return self.fate is Fate.KEPT

    @property
    def heard(self) -> bool:
        """Tell that the node may publish, so that nobody else should."""
        silenced = self.fate is Fate.NONE or (self.kept and self.gated)
        return self.kind not in QUIET and not silenced

    @property
    def babbles(self) -> bool:
        """Tell that it is kept although consumers hear what is wrong of it."""
        return self.kept and self.heard

    @property
    def silent(self) -> bool:
        """Tell that the node is silent, as one is whose computer is cut off."""
        return self.kind in MISSED


def no_accusation() -> Accusation:
    """Return what is held against nobody."""
    return Accusation("", Kind.OTHER, Fate.NONE)


@dataclass
class Case:
    """The accusations against a node, by service, and how far it is trusted.

    `before`: the trust before its last failure. `failing`: since that it was not back. `refusals`:
    how often it was killed as it came back while it is kept out.
    """

    accusations: Dict[str, Accusation] = field(default_factory=dict)
    trust: Trust = UNTRIED
    before: Trust = UNTRIED
    failed_at: float = -math.inf
    failing: bool = False
    refusals: int = 0


class _Pending(NamedTuple):
    """A kill that waits for a computer; `silent`: until that was heard beside the silence."""

    host: str
    since: float
    silent: bool


class Nodes:
    """The cases of all nodes.

    `restarted`: the nodes that were started again, and whether whoever ends us has started them
    first.
    """

    def __init__(self, robot: Robot) -> None:
        self.kills = Kills(robot.health, robot.settings)
        self.restarted: Dict[str, bool] = {}
        self._robot = robot
        self._stakes = Stakes(robot.names, robot.health, robot.indexes, robot.planner)
        self._settings = robot.settings
        self._health = robot.health
        self._cases: Dict[str, Case] = {}
        self._returns: Agenda[str] = Agenda()  # nodes that are to be started, or to come up
        self._pending: Dict[str, _Pending] = {}
        self._orphans: Set[str] = set()  # what was left behind
        self._tries: Dict[str, Tuple[int, str]] = {}  # to learn, by a topic, which process it is
        self._learning: Agenda[str] = Agenda()
        self._notes: Dict[Outcome, Callable[[KillOver], List[Said]]] = {
            Outcome.GONE: self._gone,
            Outcome.UNSURE: self._gone,
            Outcome.SPARED: self._spared,
            Outcome.ANOTHER: self._untouched,
            Outcome.UNREACHED: self._unreached,
            Outcome.WELL: self._alive,
        }

    def _host_of(self, node: str) -> str:
        """Return the other computer that a node runs on; empty: our own, or not known."""
        return self._robot.host_of(node) if self._robot.som.hosts else ""

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

    def accuse(self, service: Service, node: str, kind: Kind) -> Accusation:
        """Accuse a node of a failure on a service, perhaps once more: it is to be judged."""
        accusations = self._cases.setdefault(node, Case()).accusations
        found = accusations.setdefault(service.name, Accusation(node, kind))
        found.kind, found.fate, found.excuse, found.back = kind, Fate.OPEN, "", False
        found.gated = service.gated
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
        trust = replace(case.trust, start_at=None, awaited_by=None, well_since=well)
        stranger = node != service.node  # there may be any number of them
        self._trust(node, case, UNTRIED if stranger else trust)
        if stranger:
            del self._cases[node]

    def judge(
        self, service: Service, accusation: Accusation, replaced: bool, taken_over: bool
    ) -> List[Command]:
        """Kill a node, or keep it, unless that is decided.

        `replaced`: something could take the service over; `taken_over`: that publishes it already.
        A silent node is not killed before: what its substitute reads may be as silent as it is.
        """
        if accusation.fate in (Fate.NONE, Fate.KILLED):
            return []
        node, gone, was_kept = accusation.node, accusation.kind is Kind.NODE_GONE, accusation.kept
        before = accusation.decision if was_kept else ""
        restarted = service.policy.restarts and node == service.node and self.may_restart(node)
        verdict = self.verdict(service, node, accusation.kind, replaced, restarted)
        waits = accusation.silent and replaced and not (taken_over or restarted)
        if verdict.kill and waits:
            accusation.decision = f"{node} is killed as soon as its substitute publishes"
            accusation.fate = Fate.WAITS
            return []
        accusation.decision = verdict.why
        commands: List[Command] = []
        if verdict.kill:
            accusation.fate = Fate.KILLED
            order = self._order(service, accusation)
            if order.period > 0.0 and node == service.node and self._host_of(node):
                accusation.decision += ", unless it does well on its own computer"
            commands += self.kill(order)
        else:
            accusation.fate = Fate.KEPT
            if gone and not was_kept and service.policy is not Policy.ADVISE:
                commands += self.kill(KillNode(node, False, True, service.topic))
        if accusation.decision != before and not gone and service.policy is not Policy.ADVISE:
            commands.append(Log(Level.WARN, f"{service.topic}: {accusation.decision}."))
        return commands

    def verdict(
        self, service: Service, node: str, kind: Kind, replaced: bool, restarted: bool = False
    ) -> Verdict:
        """Decide about a node by all that is at stake."""
        verdict = decide(self._stakes.case(service, node, kind, replaced, restarted))
        if service.policy is not Policy.ADVISE:
            return verdict
        why = self._robot.waiting(service) or "healing advises"
        return Verdict(False, f"nothing is done, as {why}; else {verdict.why}")

    @staticmethod
    def _order(service: Service, accusation: Accusation) -> KillNode:
        """Return the kill of a node, by the word of its computer where its link may be to blame."""
        node, kind, silent = accusation.node, accusation.kind, accusation.silent
        period = (service.period or 0.0) if kind in BY_LINK else 0.0
        urgent = kind is not Kind.NODE_GONE
        quick = service.contain is Contain.NODE
        how = {"only_here": silent, "quick": quick}
        return KillNode(node, urgent, topic=service.topic, period=period, **how)

    def kill(self, order: KillNode) -> List[Command]:
        """Begin a kill, or let it wait: a silence must last beside the node's computer."""
        host, time = self._host_of(order.node), self._robot.time
        waits = order.only_here and (host or not order.quick)
        if waits and self._robot.computers.reachable(host):
            self._pending[order.node] = _Pending(host, time, True)
            if not host:  # our own is heard all the time
                self.kills.again.set(order.node, time + CERTAIN_S)
            return []
        self._pending.pop(order.node, None)
        order = order if host else replace(order, period=0.0)  # there is no link
        return self.kills.begin(time, order)

    # A kill goes on, and is over.

    def heed(self, event: KillEvent) -> List[Said]:
        """Go on with a kill."""
        strained = self._robot.computers.strained(self._host_of(event.node))
        return self._outcomes(self.kills.handle(event, strained))

    def tick(self) -> List[Said]:
        """Let time pass: go on with kills, restarts, and looks which process a node is."""
        time = self._robot.time
        said = self._outcomes(self.kills.tick(time))
        for node in self.kills.again.pop_due(time):
            said += self._kill_again(node)
        for node in self._returns.pop_due(time):
            said += self._return_due(node, self._cases[node])
        for node in self._learning.pop_due(time):
            said.append(events.LearnNode(node, self._tries[node][1]))
        return said

    def computer_heard(self, host: str) -> List[Said]:
        """Begin the kills that have waited for a computer."""
        if not self._robot.computers.reachable(host):
            return []
        steady, time = self._robot.computers.of(host).steady, self._robot.time
        due = [
            node
            for node, each in self._pending.items()
            if each.host == host
            and (not each.silent or time - max(each.since, steady) >= CERTAIN_S)
        ]
        said: List[Said] = []
        for node in due:
            del self._pending[node]
            said += self._kill_again(node)
        return said

    def computer_lost(self, host: str, why: str) -> List[Said]:
        """End the kills on a computer that is lost: they go on when it is back."""
        said: List[Said] = []
        for node in sorted(self._health.dying):
            if self._host_of(node) == host:
                said += self._outcomes(self.kills.unreached(self._robot.time, node, why))
        return said

    def _kill_again(self, node: str) -> List[Said]:
        """Kill a node that is still accused, and has not returned, or was left behind."""
        said: List[Said] = []
        if node in self._orphans:
            said += self.kill(KillNode(node, urgent=True))
        for name in self.accusers(node):
            service, accusation = self._robot.spec(name), self._cases[node].accusations[name]
            if service is not None and not accusation.back and not accusation.kept:
                order = self._order(service, accusation)
                said += self.kill(replace(order, urgent=True, only_here=False))
        return said

    def _outcomes(self, said: Sequence[Said]) -> List[Said]:
        """Note how kills ended, for all that accuse the node."""
        found: List[Said] = []
        for each in said:
            found += self._notes[each.outcome](each) if isinstance(each, KillOver) else [each]
        return found

    def _gone(self, kill: KillOver) -> List[Said]:
        """A node is gone, or could not be reached to make sure."""
        time, node, case = kill.time, kill.node, self._cases.get(kill.node)
        certain = kill.outcome is Outcome.GONE
        said: List[Said] = []
        self._health.gone(node, time)
        self.went(node)
        if node not in self._health.excluded:  # it is back already, as another process
            for topic in sorted(self._health.topics.get(node, ())):
                if self._health.healthy((topic, node)):
                    said += self.came_up(node, topic)
        self.forget_restarted(node)
        if certain:
            self._orphans.discard(node)
        self._settle(node)
        if case and certain:  # its last failure was its own
            doubtful = min(case.trust.doubtful, case.before.doubtful)
            self._trust(node, case, replace(case.trust, doubtful=doubtful))
        elif case:
            self._left_alone(node, case)
        return [kill, *said]

    def _spared(self, kill: KillOver) -> List[Said]:
        """Note that a node lost its connection, but still runs."""
        for accusation in self._accusations(kill.node):
            accusation.kind = Kind.SILENT
        return [kill]

    def _untouched(self, kill: KillOver) -> List[Said]:
        self._settle(kill.node)
        if kill.node in self._cases:
            self._left_alone(kill.node, self._cases[kill.node])
        return [Log(Level.ERROR, f"{kill.node} is not touched: {kill.detail}."), kill]

    def _unreached(self, kill: KillOver) -> List[Said]:
        """Finish the kill of a node when its computer is back."""
        host = self._host_of(kill.node)
        if not host:
            return self._gone(replace(kill, outcome=Outcome.UNSURE))
        silent = all(each.silent for each in self._accusations(kill.node))
        self._pending[kill.node] = _Pending(host, kill.time, silent)
        self._settle(kill.node)
        return [kill]

    def _alive(self, kill: KillOver) -> List[Said]:
        """Ask the computer of a node again while it is missed here, as it may do well there."""
        self._pending[kill.node] = _Pending(self._host_of(kill.node), kill.time, True)
        accusations = self._accusations(kill.node)
        news = any(each.excuse != kill.cause for each in accusations)
        for each in accusations:
            each.decision = f"{kill.node} is not killed: {kill.detail}, {kill.cause}"
            each.fate, each.excuse = Fate.NONE, kill.cause
        return [kill] if news else []

    def _accusations(self, node: str) -> List[Accusation]:
        return list(self._cases[node].accusations.values()) if node in self._cases else []

    def _settle(self, node: str) -> None:
        """Note that a node is gone, or cannot be reached to make sure."""
        for each in self._accusations(node):
            if each.kept:
                each.decision = f"{node} is gone"
            each.fate = Fate.NONE

    def _left_alone(self, node: str, case: Case) -> None:
        """Do no more about a node: two of one name would end each other, so it is not restarted."""
        if case.refusals:
            self.trust(node)  # it cannot be kept out, and two publishers are worse than one
        self._trust(node, case, replace(case.trust, start_at=None, awaited_by=None, exhausted=True))

    def end_orphan(self, node: str) -> List[Command]:
        """End a substitute that was left behind; a busy computer may not find it at once."""
        self._orphans.add(node)
        return self.kill(KillNode(node, urgent=True))

    # The way back.

    def hold_off(self, node: str) -> float:
        """Return how long a node must stay healthy when it returns now, in s."""
        settings = self._settings
        relapses = self._cases[node].trust.relapses if settings.switches else 0
        return doubled(settings.hold_off, relapses, settings.longest_hold_off)

    def kept_out(self, node: str) -> bool:
        """Tell that a node relapsed too often in a row to return."""
        trust = self._cases[node].trust
        return 0 < self._settings.switches <= trust.relapses - trust.doubtful

    def shown(self, accusation: Accusation) -> Dict[str, object]:
        """Return what an incident shows of the node that it blames."""
        return {
            "restarts": self.trust_in(accusation.node).restarts,
            "kept_out": self.kept_out(accusation.node),
            "kept": accusation.kept,
            "decision": accusation.decision,
        }

    def trust_in(self, node: str) -> Trust:
        """Return how far a node is trusted, and how often it was started again."""
        return self._cases[node].trust

    def may_restart(self, node: str) -> bool:
        """Tell that a node would be started again if its policy is that."""
        trust = self._cases[node].trust
        used_up = trust.exhausted or trust.restarts >= self._settings.node_restarts
        return not used_up and not self.kept_out(node)

    def awaited(self, node: str) -> bool:
        """Tell that a node is to be started, or to come up."""
        return self._returns.when(node) < math.inf

    def failed(self, time: float, service: Service, node: str, kind: Kind, soon: bool) -> None:
        """Count a failure of a node; `soon`: within its hold-off.

        It counts once until the node is back, whichever service tells of it.
        """
        case, settings = self._cases[node], self._settings
        if case.failing or kind is Kind.REQUESTED:
            return
        trust = case.trust
        case.failing, case.failed_at, case.before = True, time, trust
        if not soon:
            calm = trust.well_since is not None and time - trust.well_since > settings.stable
            trust = replace(trust, restarts=0 if calm else trust.restarts, exhausted=False)
            within = settings.relapse * settings.hold_off
            if trust.returned is None or time - trust.returned > within:
                self._forgive(node, case, trust)
                return
        by_link = kind in BY_LINK and bool(self._host_of(service.node))
        doubtful = trust.doubtful + (by_link or kind in MISSED)
        relapses = trust.relapses + 1
        trust = replace(trust, relapses=relapses, doubtful=doubtful, soon=not soon)
        self._trust(node, case, trust)

    def excuse(self, host: str, heard: float) -> List[Said]:
        """Blame no node for its silence since its computer was heard, which was cut off."""
        said: List[Said] = []
        for node, case in self._cases.items():
            silent = any(each.silent for each in case.accusations.values())
            if silent and case.failed_at >= heard and self._host_of(node) == host:
                former = case.before
                trust = replace(case.trust, relapses=former.relapses, doubtful=former.doubtful)
                self._trust(node, case, replace(trust, soon=former.soon))
                said.append(TrustChanged(heard, node))
        return said

    def left_in_order(self, event: events.NodeUnregistered) -> List[Said]:
        """Forgive a node that was told to leave, by somebody else: that is no failure."""
        case = self._cases.get(event.node, Case())
        gone = any(each.kind is Kind.NODE_GONE for each in case.accusations.values())
        if gone and case.trust.soon:
            self.trust(event.node)
        return [TrustChanged(event.time, event.node)] if gone else []

    def returned(self, service: str, node: str, since: float) -> None:
        """A node publishes a service again, `since` a moment."""
        case = self._cases[node]
        case.failing = False
        if service in case.accusations:
            case.accusations[service].back = True
        trust, awaited = case.trust, None
        if not all(each.back for each in case.accusations.values()) and self.awaited(node):
            due = self._robot.time + self._settings.restart_timeout
            awaited = trust.awaited_by or due
        self._trust(node, case, replace(trust, returned=since, start_at=None, awaited_by=awaited))

    def start_again(self, node: str) -> None:
        """Start a node that is gone again after a pause, unless it was too often."""
        case, settings = self._cases[node], self._settings
        trust = case.trust
        if trust.start_at is not None:
            return
        if self.kept_out(node) or trust.restarts >= settings.node_restarts:
            self._trust(node, case, replace(trust, exhausted=True, awaited_by=None))
            return
        due = self._robot.time + doubled(settings.restart_pause, trust.restarts)
        restarts = trust.restarts + 1
        self._trust(node, case, replace(trust, start_at=due, awaited_by=None, restarts=restarts))

    def _return_due(self, node: str, case: Case) -> List[Said]:
        """Start a node, or end one that did not come up in time."""
        specs = map(self._robot.spec, () if self._robot.ending else tuple(case.accusations))
        own = [s for s in specs if s is not None and s.policy.restarts and s.node == node]
        starts = case.trust.start_at is not None
        due = self._robot.time + self._settings.restart_timeout if starts and own else None
        self._trust(node, case, replace(case.trust, start_at=None, awaited_by=due))
        if not own:  # the policy is another by now, or the node
            return []
        topics = ", ".join(each.topic for each in own)
        if starts:
            text = f"{topics}: {node} is started again."
            return [Log(Level.INFO, text), events.RestartNode(node)]
        text = f"{topics}: {node} did not come back in time."
        order = KillNode(node, True, topic=own[0].topic)
        return [Log(Level.WARN, text), *self.kill(order)]

    def trust(self, node: str) -> None:
        """Forget the relapses of a node."""
        self._forgive(node, self._cases[node], self._cases[node].trust)

    def _forgive(self, node: str, case: Case, trust: Trust) -> None:
        case.refusals = 0
        forgiven = replace(trust, relapses=0, doubtful=0, soon=False, returned=None)
        self._trust(node, case, forgiven)

    def refuse(self, order: KillNode) -> List[Command]:
        """Kill a node that is kept out, and has come up."""
        self._cases[order.node].refusals += 1
        return self.kill(order)

    def refusals(self, node: str) -> int:
        """Return how often a node was refused, if that is to be told: ever more seldom; else 0."""
        count = self._cases[node].refusals
        return 0 if count & (count - 1) else count  # 1, 2, 4, 8, ...

    def forget_restarted(self, node: str) -> bool:
        """Note that a node that was started again is gone, or is ended. Returns that it was one."""
        self._robot.records.set(f"restarted {node}", None)
        return self.restarted.pop(node, None) is not None

    def recall(self, record: NodeRecord) -> None:
        """Trust a node as a former reconfigurator did."""
        case = self._cases.setdefault(record.node, Case())
        self._trust(record.node, case, record.trust)

    def _trust(self, node: str, case: Case, trust: Trust) -> None:
        """Change the trust in a node, and write that down."""
        if trust == case.trust:
            return
        case.trust = trust
        record = None if trust == UNTRIED else NodeRecord(node, trust)
        self._robot.records.set(f"node {node}", record)
        self._returns.set(node, trust.awaited_by if trust.start_at is None else trust.start_at)

    # Which process a node is: looked at while it is healthy, once each time that it comes up.

    def came_up(self, node: str, topic: str) -> List[Command]:
        """Learn a node that is healthy on a topic, unless it is known."""
        if node in self._tries:
            return []
        self._tries[node] = 0, topic
        return [events.LearnNode(node, topic)]

    def learned(self, event: events.NodeLearned) -> None:
        """Note what was learned; the next try follows after a pause if it failed."""
        health = self._health
        if not event.known and event.node in self._tries:
            tries, topic = self._tries[event.node]
            self._tries[event.node] = min(tries + 1, len(LEARN_PAUSES_S) - 1), topic
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

    def validate(self) -> None:
        """Raise ShsaError if a node is to be killed, and nothing will happen."""
        for node, case in self._cases.items():
            killed = any(each.fate is Fate.KILLED for each in case.accusations.values())
            if killed and node not in self._health.dying and node not in self._pending:
                raise ShsaError(f"{node} is to be killed, and nothing will ever happen")

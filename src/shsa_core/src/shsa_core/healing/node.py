"""One case a node, whoever accuses it: what becomes of it, and its way back.

This is the one place that decides whether a node is killed or kept; how it is killed is in `kill`.
A node that is gone is started again by its policy, after pauses that double, and no more when it
failed too often. Whoever starts it, its hold-off doubles each time that it relapses; then it is
kept out. A silence that nobody ended, and what may be its link's, keep nobody out.
"""
import math
from dataclasses import dataclass, field, replace
from typing import Callable, Dict, List, Optional, Sequence

from shsa_core.agenda import Agenda, doubled
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.containment import Stakes
from shsa_core.healing.events import Command, Log
from shsa_core.healing.health import MISSED
from shsa_core.healing.kill import KillEvent, KillNode, KillOver, Kills, Outcome, Said
from shsa_core.healing.records import Fate, NodeRecord, Trust
from shsa_core.healing.robot import Robot
from shsa_core.model.kinds import BY_LINK, QUIET, Contain, Kind, Policy
from shsa_core.model.log import Level
from shsa_core.model.service import Service
from shsa_core.planning.settings import CERTAIN_S

UNTRIED = Trust()
REPRIEVES = 3
"""A node that speaks again recovers while it has two."""


@dataclass
class Accusation:
    """A node failed on the topic of a service; by default nothing is held against anybody.

    `decision` says in words what becomes of it. `excuse`: what else may be the cause, as its own
    computer tells; empty: not known. `gated`: consumers hear a gate.
    """

    node: str = ""
    kind: Kind = Kind.OTHER
    topic: str = ""
    fate: Fate = Fate.NONE
    decision: str = ""
    excuse: str = ""
    gated: bool = False
    back: bool = False  # it publishes again
    reprieves: int = 0  # from being killed as silent, since it spoke
    spared: bool = False  # it was told to be gone, and runs

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
    def silent(self) -> bool:
        """Tell that the node is silent, as one is whose computer is cut off."""
        return self.kind in MISSED


@dataclass
class Case:
    """The accusations against a node, by service, and how far it is trusted.

    `failing`: it was not back since its last failure; `doubtful`: of how many relapses it was not
    sure before that. `refusals`: how often it was killed as it came back while it is kept out.
    """

    accusations: Dict[str, Accusation] = field(default_factory=dict)
    trust: Trust = UNTRIED
    doubtful: int = 0
    failing: bool = False
    refusals: int = 0


class Nodes:
    """The cases of all nodes; `told` tells their accusers that a kill is over."""

    def __init__(self, robot: Robot, told: Callable[[KillOver], List[Command]]) -> None:
        self._told = told
        self.kills = Kills(robot)
        self._robot = robot
        self.stakes = Stakes(robot)
        self._settings, self._health = robot.settings, robot.health
        self._cases: Dict[str, Case] = {}
        self._returns: Agenda[str] = Agenda()  # nodes that are to be started, or to come up

    @property
    def deadline(self) -> float:
        """Return when `tick` has something to do, in s; infinite: nothing is due."""
        kills, identities = self.kills, self._robot.identities
        agendas = kills.agenda, kills.again, self._returns, identities.agenda
        return min(agenda.next() for agenda in agendas)

    def accusers(self, node: str) -> List[str]:
        """Return the services that accuse a node."""
        return sorted(self._held(node))

    # A node fails, and is judged.

    def accuse(self, service: Service, node: str, kind: Kind) -> Accusation:
        """Accuse a node of a failure on a service, perhaps once more: it is to be judged."""
        accusations = self._cases.setdefault(node, Case()).accusations
        found = accusations.setdefault(service.name, Accusation(node, kind, service.topic))
        found.kind, found.fate, found.excuse, found.back = kind, Fate.OPEN, "", False
        found.spared, found.gated = False, service.gated
        return found

    def acquit(self, service: Service, node: str, well_at: Optional[float] = None) -> None:
        """Accuse a node no more; `well_at`: it has outlived its hold-off then."""
        case = self._cases[node]
        del case.accusations[service.name]
        if case.accusations:
            return
        case.failing = False
        self.kills.forget(node)
        well = case.trust.well_since if well_at is None else well_at
        trust = replace(case.trust, start_at=None, awaited_by=None, well_since=well)
        stranger = node != service.node  # there may be any number of them
        self.trust(node, UNTRIED if stranger else trust)
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
        restarted = self._restarts(service, accusation)
        verdict = self.stakes.verdict(service, node, accusation.kind, replaced, restarted)
        waits = accusation.silent and replaced and not (taken_over or restarted)
        if verdict.kill and waits:
            accusation.decision = f"{node} is killed as soon as its substitute publishes"
            accusation.fate = Fate.WAITS
            return []
        accusation.decision = verdict.why
        accusation.fate = Fate.KILLED if verdict.kill else Fate.KEPT
        order, commands = self._order(service, accusation), []
        if verdict.kill and order.period and node == service.node and self._robot.host_of(node):
            accusation.decision += ", unless it does well on its own computer"
        if verdict.kill or (gone and not was_kept and service.policy is not Policy.ADVISE):
            commands += self.kills.order(order)
        known = was_kept and accusation.silent and not verdict.kill
        news = accusation.decision != before and not known
        if news and not gone and service.policy is not Policy.ADVISE:
            commands.append(Log(Level.WARN, f"{service.topic}: {accusation.decision}."))
        return commands

    def _restarts(self, service: Service, accusation: Accusation) -> bool:
        """Tell that a node is started again once it is killed."""
        node, trust = accusation.node, self._cases[accusation.node].trust
        used_up = trust.exhausted or trust.restarts >= self._settings.node_restarts
        restarts = service.policy.restarts and node == service.node and not used_up
        if service.event_driven and accusation.silent:
            sure = accusation.spared or accusation.kind is not Kind.SILENT
            # Else it need not say a thing: only a connection was lost, or a link.
            restarts &= sure and not self._robot.host_of(node)
        return restarts and node in self._health.startable and not self.kept_out(node)

    def _stands(self, service: Service, accused: Accusation) -> bool:
        """Tell that a kill that waits is still to be, or one that was in vain."""
        again = accused.fate is Fate.NONE or self._restarts(service, accused)
        replaced = not accused.excuse or service.name not in self._robot.indexes.stuck
        again &= replaced
        return self.stakes.verdict(service, accused.node, accused.kind, replaced, again).kill

    @staticmethod
    def _order(service: Service, accusation: Accusation) -> KillNode:
        """Return the kill of a node, by the word of its computer where its link may be to blame."""
        kind = accusation.kind
        return KillNode(
            accusation.node,
            service.topic,
            if_dead=kind is Kind.NODE_GONE,  # who lost its connections may live
            only_here=accusation.silent,
            period=(service.period or 0.0) if kind in BY_LINK else 0.0,
            quick=service.contain is Contain.NODE,
        )

    # A kill goes on, and is over.

    def heed(self, event: KillEvent) -> List[Command]:
        """Go on with a kill; one for silence alone spares a node that speaks as it is found."""
        node, held = event.node, [e for e in self._held(event.node).values() if not e.kept]
        quiet = all(e.back or e.kind in QUIET for e in held)
        speaks = quiet and all(self._health.healthy((e.topic, node)) for e in held)
        return self._outcomes(self.kills.handle(event, bool(held) and speaks, self._refused(node)))

    def tick(self) -> List[Command]:
        """Let time pass: go on with kills and restarts, and learn which process a node is."""
        time = self._robot.time
        commands = self._outcomes(self.kills.tick(time))
        for node in self.kills.due():
            commands += self._kill_again(node)
        for node in self._returns.pop_due(time):
            commands += self._return_due(node, self._cases[node])
        return commands + self._robot.identities.due(time)

    def computer_lost(self, host: str, why: str) -> List[Command]:
        """End the kills on a computer that is lost: they go on when it is back."""
        there = [node for node in sorted(self._health.dying) if self._robot.host_of(node) == host]
        time = self._robot.time
        return self._outcomes([s for n in there for s in self.kills.unreached(time, n, why)])

    def _kill_again(self, node: str) -> List[Command]:
        commands: List[Command] = []
        for name, accusation in sorted(self._held(node).items()):
            service = self._robot.spec(name)
            if service is None or accusation.back or (accusation.kept and not accusation.spared):
                continue
            if accusation.kept:
                order = KillNode(node, service.topic, if_dead=True)
            elif accusation.silent and self._speaks(service, accusation):
                accusation.reprieves += 1
                self.kills.wait(node, service.period or 0.0)
                continue
            elif not self._stands(service, accusation):
                accusation.fate = Fate.OPEN
                commands += self._told(KillOver(self._robot.time, node, Outcome.SPARED))
                continue
            else:
                order = replace(self._order(service, accusation), only_here=False, if_dead=False)
            commands += self.kills.order(order)
        return commands

    def _speaks(self, service: Service, accused: Accusation) -> bool:
        """Tell that a node was heard so lately that it may not be silent any more, or trickles."""
        row = self._health.row((service.topic, accused.node))
        if row is None or accused.reprieves >= REPRIEVES:
            return False
        if row.last_good is None or not row.has_failed:
            return not row.has_failed  # connected anew, perhaps as another process that starts up
        patience = max(CERTAIN_S, self._settings.deadlines.longest(service) or 0.0)
        return row.last_good > max(row.since, self._robot.time - patience)

    def _outcomes(self, said: Sequence[Said]) -> List[Command]:
        """Note how all kills have ended before those who accuse a node hear of any."""
        noted: List[Said] = []
        for each in said:
            noted += self._over(each) if isinstance(each, KillOver) else [each]
        commands: List[Command] = []
        for each in noted:
            commands += self._told(each) if isinstance(each, KillOver) else [each]
        return commands

    def _over(self, kill: KillOver) -> List[Said]:
        """Note how a kill ended: whoever is not heard of or may do well is killed later."""
        node, held = kill.node, self._held(kill.node).values()
        accusations = [each for each in held if each.topic not in kill.failing]
        for each in held:  # who fails is its next life: it is judged anew
            row = self._health.row((each.topic, node))
            if each.topic in kill.failing and row:
                each.fate, each.kind = Fate.OPEN, row.kind or Kind.OTHER
        if kill.outcome is not Outcome.GONE:  # what it is kept for goes on as before
            accusations = [e for e in accusations if not e.kept or e.kind is Kind.NODE_GONE]
        if kill.outcome is Outcome.SPARED:
            for each in accusations:
                if each.kind is Kind.NODE_GONE and each.fate is not Fate.NONE:
                    each.kind, each.spared = Kind.SILENT, True  # it lost its connection, but runs
                each.fate = Fate.OPEN if each.fate is Fate.KILLED else each.fate
            stands = any(each.fate is not Fate.NONE for each in held)
            if stands or self._refused(node):  # not let in after all
                self.kills.try_again(node)  # it may end by itself
            return [kill]
        if kill.outcome is Outcome.WELL:
            self.kills.wait(node)
            news = any(each.excuse != kill.cause for each in accusations)
            for each in accusations:
                each.decision, each.fate, each.excuse = kill.told, Fate.NONE, kill.cause
            return [replace(kill, news=news)]
        fate = Fate.KEPT if kill.outcome is Outcome.PROTECTED else Fate.NONE
        for each in accusations:
            each.decision = f"{node} is gone" if each.kept else each.decision
            each.fate = fate
        if kill.outcome is Outcome.GONE:
            return [kill, *self._gone(kill)]
        if kill.outcome is Outcome.UNREACHED:
            self.kills.wait(node)
            return [kill]
        self._leave_alone(node)
        if kill.outcome is Outcome.UNSURE:
            return [kill]
        return [Log(Level.ERROR, f"{node} is not touched: {kill.detail}."), kill]

    def _gone(self, kill: KillOver) -> List[Command]:
        """Forget the process of a node that is gone."""
        node, case = kill.node, self._cases.get(kill.node)
        commands: List[Command] = []
        self._health.verified.discard(node)
        self._robot.identities.went(node)
        rows = [row for row in self._health.of_node(node) if row.is_well]
        if any(row.since > kill.time for row in rows):  # it is back already, as another process
            for row in rows:
                commands += self._robot.identities.came_up(node, row.topic)
        else:
            self._health.excluded[node] = kill.time
        self._robot.restarted.discard(node)
        if case:  # its last failure was its own
            doubtful = min(case.trust.doubtful, case.doubtful)
            self.trust(node, replace(case.trust, doubtful=doubtful))
        return commands

    def _held(self, node: str) -> Dict[str, Accusation]:
        return self._cases[node].accusations if node in self._cases else {}

    def _leave_alone(self, node: str) -> None:
        """Do no more about a node: two of one name would end each other, so it is not restarted."""
        case = self._cases.get(node)
        if case and case.refusals:
            self.forgive(node)  # it cannot be kept out, and two publishers are worse than one
        if case:
            self.trust(node, replace(case.trust, start_at=None, awaited_by=None, exhausted=True))

    # The way back.

    def hold_off(self, node: str) -> float:
        """Return how long a node must stay healthy when it returns now, in s."""
        relapses = self._cases[node].trust.relapses if self._settings.switches else 0
        return self._settings.held_off(relapses)

    def kept_out(self, node: str) -> bool:
        """Tell that a node relapsed too often in a row to return."""
        trust = self._cases[node].trust
        return 0 < self._settings.switches <= trust.relapses - trust.doubtful

    def shown(self, accusation: Accusation) -> Dict[str, object]:
        """Return what an incident shows of the node that it blames."""
        return {
            "restarts": self.trust_in(accusation.node).restarts,
            "kept_out": self.kept_out(accusation.node) and not accusation.kept,
            "kept": accusation.kept,
            "decision": accusation.decision,
        }

    def trust_in(self, node: str) -> Trust:
        """Return how far a node is trusted, and how often it was started again."""
        return self._cases[node].trust

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
        case.failing, case.doubtful = True, trust.doubtful
        if not soon:
            calm = trust.well_since is not None and time - trust.well_since > settings.stable
            trust = replace(trust, restarts=0 if calm else trust.restarts, exhausted=False)
            within = settings.relapse * settings.hold_off
            if trust.returned is None or time - trust.returned > within:
                self.trust(node, trust)
                self.forgive(node)
                return
        by_link = kind in BY_LINK and bool(self._robot.host_of(service.node))
        doubtful = trust.doubtful + (by_link or kind in MISSED)
        trust = replace(trust, relapses=trust.relapses + 1, doubtful=doubtful, soon=not soon)
        self.trust(node, trust)

    def left_in_order(self, node: str) -> None:
        """Forgive a node that was told to leave, by somebody else: that is no failure."""
        gone = any(each.kind is Kind.NODE_GONE for each in self._held(node).values())
        if gone and self._cases[node].trust.soon:
            self.forgive(node)

    def returned(self, service: str, node: str, since: float, by: str) -> None:
        """A service is published again, `since` a moment: `by` its node itself, or another."""
        case = self._cases[node]
        case.failing = False
        accusation = case.accusations[service]
        accusation.back, accusation.reprieves = True, 0
        trust, awaited = case.trust, None
        if not all(each.back for each in case.accusations.values()) and self.awaited(node):
            awaited = trust.awaited_by or self._robot.time + self._settings.restart_timeout
        start = None if by == node else trust.start_at
        self.trust(node, replace(trust, returned=since, start_at=start, awaited_by=awaited))

    def start_again(self, node: str) -> None:
        """Start a node that is gone again after a pause, unless it was too often."""
        trust, settings = self._cases[node].trust, self._settings
        if trust.start_at is not None:
            return
        if self.kept_out(node) or trust.restarts >= settings.node_restarts:
            self.trust(node, replace(trust, exhausted=True, awaited_by=None))
            return
        due = self._robot.time + doubled(settings.restart_pause, trust.restarts)
        restarts = trust.restarts + 1
        self.trust(node, replace(trust, start_at=due, awaited_by=None, restarts=restarts))

    def _return_due(self, node: str, case: Case) -> List[Command]:
        specs = map(self._robot.spec, tuple(case.accusations))
        own = [s for s in specs if s is not None and s.policy.restarts and s.node == node]
        starts = case.trust.start_at is not None
        patience = doubled(self._settings.restart_timeout, case.trust.restarts - 1)
        awaited = starts and own and not all(each.back for each in case.accusations.values())
        due = self._robot.time + patience if awaited else None
        self.trust(node, replace(case.trust, start_at=None, awaited_by=due))
        if not own:  # the policy is another by now, or the node
            return []
        topics = ", ".join(each.topic for each in own)
        if starts:
            gone, rows = self._health.excluded.get(node, -math.inf), self._health.of_node(node)
            if any(not row.has_failed and row.since > gone for row in rows):
                return []  # somebody else has started it, and it has its time to come up
            text = f"{topics}: {node} is started again."
            return [Log(Level.INFO, text), events.RestartNode(node)]
        text = f"{topics}: {node} did not come back in time."
        accused = [case.accusations[each.name] for each in own]
        order = KillNode(node, own[0].topic, if_dead=not any(map(self._stands, own, accused)))
        for each in accused if order.if_dead else ():  # it is judged again if it runs
            each.kind, each.fate = Kind.NODE_GONE, Fate.OPEN
        return [Log(Level.WARN, text), *self.kills.order(order)]

    def forgive(self, node: str, wholly: bool = False) -> None:
        """Forget the relapses of a node; `wholly`: how often it was started again, too."""
        case = self._cases[node]
        case.refusals = 0
        trust = replace(case.trust, restarts=0, exhausted=False) if wholly else case.trust
        self.trust(node, replace(trust, relapses=0, doubtful=0, soon=False, returned=None))

    def refuse(self, node: str, topic: str) -> List[Command]:
        """Kill a node that is kept out, and has come up."""
        self._cases[node].refusals += 1
        return self.kills.order(KillNode(node, topic, at_once=True))

    def refusals(self, node: str) -> int:
        """Return how often a node was refused, if that is to be told: ever more seldom; else 0."""
        count = self._cases[node].refusals
        return 0 if count & (count - 1) else count  # 1, 2, 4, 8, ...

    def _refused(self, node: str) -> bool:
        return node in self._cases and self._cases[node].refusals > 0

    def trust(self, node: str, trust: Trust) -> None:
        """Trust a node so far from now on."""
        case = self._cases.setdefault(node, Case())
        if trust == case.trust:
            return
        case.trust = trust
        record = None if trust == UNTRIED else NodeRecord(node, trust)
        self._robot.records.set(f"node {node}", record)
        self._returns.set(node, trust.awaited_by if trust.start_at is None else trust.start_at)

    def validate(self) -> None:
        """Raise ShsaError if a node is to be killed, and nothing will happen."""
        for node, case in self._cases.items():
            killed = (e.fate is Fate.KILLED and not e.back for e in case.accusations.values())
            if any(killed) and not self.kills.under_way(node):
                raise ShsaError(f"{node} is to be killed, and nothing will ever happen")

"""The machine of one service: what publishes it now, and what should.

`transitions` has the states as a table, and `repair` what heals. Here what happens is made into the
triggers of that table.
"""
import math
from collections import deque
from contextlib import suppress
from dataclasses import replace
from typing import Callable, Deque, Dict, FrozenSet, List, Mapping, Optional, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing.events import Command, FailureSeen, Log, RestartFailed, ShowIncident
from shsa_core.healing.health import MISSED
from shsa_core.healing.incident import SUBSTITUTED, WAITING, WELL, State, Trigger
from shsa_core.healing.kill import KillOver, Outcome
from shsa_core.healing.node import Accusation, Nodes
from shsa_core.healing.process import Processes, Substitute
from shsa_core.healing.robot import Robot
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Kind, OnPartition, Policy
from shsa_core.model.log import Level
from shsa_core.model.service import Service
from shsa_core.model.substitution import CHANGEOVER_S, Substitution

Failure = Optional[FailureSeen]
Action = Callable[["ServiceMachine", Failure], List[Command]]
Transitions = Mapping[Tuple[State, Trigger], Tuple[Action, FrozenSet[State]]]


class InvalidTransition(ShsaError):
    """A state was to be left in a way that it does not have; the story tells what led to it."""


class ServiceMachine:
    """At most one open incident of a service, and at most one substitute.

    A hot service has its substitute before the incident and keeps it after: muted, and computing.
    `spec`: the service as it counts now. `accusation`: what is held against the node that the
    incident blames. `last_message`: the last good one of the service, serialized.
    """

    def __init__(
        self,
        spec: Service,
        robot: Robot,
        nodes: Nodes,
        processes: Processes,
        transitions: Transitions,
    ) -> None:
        self.spec = spec
        self.robot = robot
        self.nodes = nodes
        self.processes = processes
        self._transitions = transitions
        self.incident = WELL
        self.accusation = Accusation()
        self.substitute = Substitute(spec.name, robot, processes)
        self.timers: Dict[Trigger, float] = {}
        self.pauses = 0
        self.last_message = b""
        self._message_came = -math.inf
        self._story: Deque[Tuple[float, State, Trigger, State]] = deque(maxlen=20)

    @property
    def state(self) -> State:
        """Return how the service does."""
        return self.incident.state

    @property
    def node(self) -> str:
        """Return the substitute's node name; empty without one."""
        return self.substitute.node

    @property
    def publishes(self) -> bool:
        """Tell that the substitute publishes: the node is gone, and the original is not back."""
        return self.state in (*SUBSTITUTED, State.SAFE) and not self.accusation.heard

    @property
    def yields(self) -> bool:
        """Tell that the substitute is to be still once the faulty node is heard again.

        It is if that was only silent, and nobody has made sure that it is gone, and in maintenance.
        On a shared topic somebody else is heard; there only one that a cut may part from it hears.
        """
        lasts = self.incident.killed is None and self.accusation.kind in MISSED
        apart = self.parted or len(self.robot.som.of_topic(self.spec.topic)) == 1
        return (lasts or self.robot.maintained) and apart and self.publishes

    @property
    def parted(self) -> bool:
        """Tell that a cut may part the substitute from us, or from the original."""
        return bool(self.substitute.host or self.robot.computers.name(self.spec.host))

    @property
    def refuses(self) -> bool:
        """Tell that the faulty node is gone, and may not return."""
        gone = self.incident.killed is not None and self.state is not State.RETURNING
        return gone and self.nodes.kept_out(self.incident.faulty_node)

    @property
    def originals(self) -> Tuple[PublisherHealth, ...]:
        """Return the rows of the publishers that are no substitutes."""
        robot = self.robot
        return robot.health.originals(robot.som, robot.som.services.get(self.spec.name, self.spec))

    def fire(self, trigger: Trigger, failure: Optional[FailureSeen] = None) -> List[Command]:
        """Do what the table says. Raises InvalidTransition if it says nothing."""
        before = self.state
        if (before, trigger) not in self._transitions:
            raise self._invalid(f"{before}: nothing is to be done about '{trigger}'")
        act, ends = self._transitions[before, trigger]
        commands = act(self, failure)
        self._story.append((self.robot.time, before, trigger, self.state))
        if self.state not in ends:
            raise self._invalid(f"'{trigger}' does not lead from {before} to {self.state}")
        return commands

    def _invalid(self, what: str) -> InvalidTransition:
        steps = [f"{time:.3f} {state} -> {to}: {why}" for time, state, why, to in self._story]
        return InvalidTransition("\n  ".join([f"{self.spec.name}: {what}. Before that:", *steps]))

    def step(self, **changes: object) -> List[Command]:
        """Change the incident, and show it."""
        changes.update(self.nodes.shown(self.accusation))
        self.incident = replace(self.incident, **changes)  # type: ignore[arg-type]
        return [ShowIncident(self.incident)]

    def log(self, text: str, level: Level = Level.WARN) -> Log:
        """Return a line of the log that begins with the topic."""
        return Log(level, f"{self.spec.topic}: {text}")

    def shown(self, plan: Optional[Plan]) -> Dict[str, object]:
        """Return what an incident shows of the plan that is carried out, or could be."""
        unavailable = self.robot.availability.unavailable - {self.spec.name}
        return {"unavailable": tuple(sorted(unavailable)), **self.robot.planner.shown(plan)}

    # A publisher fails.

    def failed(self, event: FailureSeen) -> List[Command]:
        """Decide about a publisher that failed, and heal unless another original carries on."""
        self.note_message(event)
        if self.node and event.publisher == self.node:
            return self._own_failed(event)
        node, incident = event.publisher or self.spec.node, self.incident
        gone, dying = event.kind is Kind.NODE_GONE, node in self.robot.health.dying
        if node == incident.faulty_node:
            if gone and dying and incident.state is not State.RETURNING:
                self.accusation.kind = event.kind  # its process may take a while longer
                return []
            refused = self.refuses and (gone or dying) and not self.accusation.kept
            if refused or event.time <= (incident.killed or -math.inf):
                return []  # it came back and is killed for that, or that process is gone
        if incident.state is State.WELL:
            well = (row.publisher for row in self.originals if row.is_well)
            others = [each for each in well if each != node and each not in self.robot.health.dying]
            if others:
                accusation = self.nodes.accuse(self.spec, node, event.kind)
                commands = self.judge(accusation, replaced=True)
                self.nodes.acquit(self.spec, node)
                text = f"{node} failed ({event.detail}); {others[0]} carries on."
                return [*commands, self.log(text)]
        commands = self.fire(Trigger.FAILED, replace(event, publisher=node))
        return commands + self._notice_first_message()  # by a bridge, heard before the failure

    def judge(
        self, accusation: Accusation, plan: Optional[Plan] = None, replaced: bool = False
    ) -> List[Command]:
        """Have it decided what becomes of a node whose place a plan takes, or another node."""
        spec = self.spec
        if spec.policy.restarts and accusation is not self.accusation:  # nobody would start it
            spec = replace(spec, policy=Policy.SUBSTITUTE)
        replaced = replaced or (plan is not None and plan.computes and not plan.left_out)
        return self.nodes.judge(spec, accusation, replaced, self.state is State.HEALED)

    def note_message(self, event: FailureSeen) -> None:
        """Keep the newest last good message: of the original, or of what was computed for it."""
        good = event.good_until
        safe_values = event.publisher == self.node and not self.substitute.computes
        stranger = event.kind is Kind.UNKNOWN_PUBLISHER
        if event.last_message and good >= self._message_came and not (safe_values or stranger):
            self.last_message, self._message_came = event.last_message, good

    def _own_failed(self, event: FailureSeen) -> List[Command]:
        if event.kind is Kind.NO_VALUE:
            follows = self.substitute.computes and self.state in (State.WELL, *SUBSTITUTED)
            return self.fire(Trigger.NO_VALUE) if follows else []
        changes = self.robot.time < self.substitute.changed + CHANGEOVER_S
        may_be_silent = event.kind is Kind.SILENT and (changes or self.yields)
        if may_be_silent and self.state not in SUBSTITUTED:
            return []
        if self.state is not State.WELL and event.last_good is not None:
            self.incident = replace(self.incident, last_good=event.last_good)
        if may_be_silent:
            return self.fire(Trigger.SILENT, event) + self._notice_first_message()
        slow = event.kind is Kind.RATE_LOW and self.state is State.HEALED
        if slow and self.substitute.another(self.spec, self.incident.faulty_node) is None:
            text = f"the substitute is slow ({event.detail}), and goes on: there is no other."
            return [self.log(text), *self.step()]
        elsewhere = event.kind is Kind.SILENT and bool(self.substitute.host)  # or cut off
        tried = event.kind is not Kind.NODE_GONE and not elsewhere
        return self.substitute_failed(event.detail, tried)

    # The node that is blamed: its kill goes on, it comes back, or it is judged again.

    def heed(self, kill: KillOver) -> List[Command]:
        """Go on by how the kill of the faulty node has ended; by then it may do well."""
        fails = self.spec.topic in kill.failing
        if kill.outcome is Outcome.GONE and not fails:
            return self._killed(kill) + self.changed()
        if kill.outcome is Outcome.SPARED or fails:
            # It may be killed for its silence, or for what its next life has done.
            out = self.refuses and kill.node not in self.robot.health.protected
            commands: List[Command] = [] if fails or out else self.changed()
            if not self.accusation.back:
                commands += self.judge(self.accusation, self.substitute.plan)
            return [*commands, *self.step(), *self.replan()]
        over = kill.outcome in (Outcome.UNSURE, Outcome.ANOTHER, Outcome.PROTECTED)
        said = self.log(f"{kill.told}.", Level.ERROR if over else Level.WARN)
        commands = [said, *self.step(detail=said.text)] if kill.news else []
        if self.accusation.kind is Kind.REQUESTED and self.state is not State.RETURNING:
            return [*commands, *self.fire(Trigger.REPLAN)]
        commands += self.replan() if over else []
        return commands if self.refuses else commands + self.changed()

    def restart_failed(self, event: RestartFailed) -> List[Command]:
        """Try to start the faulty node again, if it may be, and is not back by other means."""
        if self.incident.killed is None or self._speaks_again():
            return []  # the word is late, or somebody else has started it
        self.start_node()
        text = f"{event.node} cannot be started again: {event.detail}."
        return [self.log(text, Level.ERROR), *self.replan()]

    def _killed(self, event: KillOver) -> List[Command]:
        """Note that the faulty node is gone; name whoever starts it while it is kept out."""
        kept_out = self.nodes.kept_out(event.node)
        if not kept_out:
            self.start_node()
        commands: List[Command] = []
        count, text = self.nodes.refusals(event.node), ""
        if count:
            times = "once" if count == 1 else f"{count} times"
            text = f"{event.node} is kept out, and was started again {times}"
            text += f" by {event.starter}" if event.starter else ""
        elif kept_out and self.incident.killed is None:
            text = f"{event.node} keeps failing, and is kept out"
        if text:
            how = f"or, with operator:=true, rosservice call /shsa/release {self.spec.topic}"
            said = self.log(f"{text}. Repair it, and restart healing {how}", Level.ERROR)
            commands = [said, *self.step(detail=f"{text}.")]
        return [*commands, *self.step(killed=event.time), *self.replan()]

    def start_node(self, anew: bool = False) -> None:
        """Start the faulty node again, if that is its policy; `anew`: unless it is due, or vain."""
        node, nodes = self.incident.faulty_node, self.nodes
        busy = self.accusation.kept or nodes.awaited(node) or nodes.kills.under_way(node)
        if anew and (self.incident.killed is None or busy or nodes.kept_out(node)):
            return
        vain = node in self.robot.abandoned or (anew and nodes.trust_in(node).exhausted)
        if self.spec.policy.restarts and node == self.spec.node and not vain:
            nodes.start_again(node)

    def came_up(self) -> List[Command]:
        """Kill a node that is kept out as soon as it is there, before it is heard.

        The substitute goes on. Who costs what nothing replaces is let in once it publishes.
        """
        node, nodes, robot = self.incident.faulty_node, self.nodes, self.robot
        if not self.refuses or self.accusation.kept or node in robot.health.dying:
            return []
        others = {*nodes.accusers(node)} - {self.spec.name}
        if others.intersection(robot.indexes.stuck + robot.indexes.kept):
            return []  # it may bring a service that nothing else gives
        verdict = nodes.stakes.verdict(self.spec, node, Kind.OTHER, self.substitute.whole)
        return nodes.refuse(node, self.spec.topic) if verdict.kill else []

    def released(self) -> List[Command]:
        """Let return what is kept out, and try again what was given up."""
        if self.state is State.WELL:
            return []
        self.nodes.forgive(self.incident.faulty_node, wholly=True)
        return [*self.step(), *self.replan()]

    # The substitute's process.

    def started(self, time: float) -> List[Command]:
        """Note that the process of the substitute was started."""
        return [] if self.state is State.WELL else self.step(spawned=time)

    def substitute_failed(self, why: str, tried: bool = False) -> List[Command]:
        """Replace the substitute; its plan is not tried again if `tried`."""
        commands = [*self.substitute.failed(tried), self.log(f"the substitute failed: {why}.")]
        return commands + self.fire(Trigger.SUBSTITUTE_FAILED)

    def rehost(self) -> List[Command]:
        """Move a substitute that stands by to where it belongs: the computers are others now.

        One that publishes stays where it is, as long as that is allowed, and it is heard if its
        computer is not: only the agent may have died. Of one whose messages are due at no time,
        that cannot be said.
        """
        substitute, robot, spec, why = self.substitute, self.robot, self.spec, ""
        if substitute.plan is None:
            return []
        host, well = substitute.host, self.state is State.WELL
        lost = robot.computers.lost(host)
        if lost:
            heard = robot.health.healthy((spec.topic, self.node)) and not spec.event_driven
            stays = heard and self.publishes
            why = "" if stays else f"cannot be reached: {host} is lost: {lost}"
        elif not self.processes.placement.allowed(spec, host):
            why = f"must not run on {host or 'here'}"
        elif well:
            with suppress(ShsaError):  # it has a place
                place = self.processes.place(spec, substitute.plan).host
                why = "" if place == host else f"moves to {place or 'our own computer'}"
        if not why:
            return []
        said = self.log(f"the substitute {self.node} {why}.")
        commands = [*substitute.drop(), said]
        return commands + self.fire(Trigger.REPLAN if well else Trigger.SUBSTITUTE_FAILED)

    # The world changes.

    def changed(self) -> List[Command]:
        """Notice by health or SOM a first message, a return, or a lost input."""
        for row in self.originals if self.state is not State.WELL else ():
            if row.has_failed:  # its last good message may be known only now
                self.note_message(self.robot.health.failure(row))
        commands = self._notice_first_message()
        refused = self.came_up() if self._speaks_again() else []
        back = not refused and self.returned() is not None
        commands += self.fire(Trigger.RETURNED) if back else refused
        plan = self.substitute.plan
        if self.state in SUBSTITUTED and plan is not None and not self.robot.planner.usable(plan):
            commands.append(self.log("the substitute lost an input."))
            commands += self.fire(Trigger.REPLAN)
        return commands

    def replan(self) -> List[Command]:
        """Plan and decide anew: another plan may be best, or the node cost something else."""
        state = self.state
        if Trigger.REPLAN in self.timers:
            return []  # the monitors have a moment to tell first
        if not (self.accusation.back or self._speaks_again()):
            self.start_node(anew=True)
        well = state is State.WELL and Trigger.RETRY not in self.timers
        waits = state in WAITING or (state is State.HEALING and not self.node)
        waits = waits or (state in SUBSTITUTED and self.spec.name in self.robot.indexes.stuck)
        kept = self.accusation.kept and state is not State.RETURNING
        return self.fire(Trigger.REPLAN) if well or waits or kept else []

    def tick(self) -> List[Command]:
        """Act on the timers that are due."""
        commands: List[Command] = []
        for trigger, due in list(self.timers.items()):
            if self.robot.time >= due and trigger in self.timers:
                del self.timers[trigger]
                commands += self.fire(trigger)
        return commands

    def first_message(self) -> Optional[float]:
        """Return when the substitute published first in this takeover, or had recovered."""
        row = self.robot.health.rows[self.spec.topic].get(self.substitute.node)
        moments = (row.first_message, row.since) if row is not None and row.is_well else ()
        since = self.substitute.working_since
        return next((m for m in moments if m is not None and m >= since), None)

    def _notice_first_message(self) -> List[Command]:
        if self.state is not State.HEALING or not self.node or self.first_message() is None:
            return []
        return self.fire(Trigger.FIRST_MESSAGE)

    def _speaks_again(self) -> bool:
        row = self.robot.health.row((self.spec.topic, self.incident.faulty_node))
        gone = self.incident.killed
        return row is not None and gone is not None and not row.has_failed and row.since > gone

    def returned(self) -> Optional[PublisherHealth]:
        """Return the row of an original that is well since the failure; None: there is none.

        While the faulty life is being ended, and is quiet, its node's next one may be.
        """
        incident, health = self.incident, self.robot.health
        if incident.state in (State.WELL, State.RETURNING):
            return None
        node = incident.faulty_node
        quiet = not (self.accusation.heard or self.nodes.kept_out(node))
        if node in health.dying and not (quiet and health.succeeded(node)):
            return None
        failed_at = incident.detected if incident.killed is None else incident.killed
        return next((row for row in self.originals if row.is_well and row.since > failed_at), None)

    # What is shown, and written down.

    def row(self) -> Optional[Substitution]:
        """Return the row of the substitute in the table; None: there is none."""
        substitute, plan, spec = self.substitute, self.substitute.plan, self.spec
        if plan is None or not substitute.node:
            return None
        publishes, yields = self.publishes, self.yields
        awaited = yields and not self.robot.maintained and self.incident.faulty_node == spec.node
        own = self.robot.health.rows[spec.topic].get(spec.node)
        return self.robot.planner.row(
            spec,
            plan,
            node=substitute.node,
            publishing=publishes,
            original=self._original,
            last_message=self.last_message,
            host=substitute.host,
            on_partition=spec.on_partition if self.parted else OnPartition.WAIT,
            yields=yields,
            bridge=0.0 if publishes else self._bridge(),
            gated=spec.gated,
            shared=substitute.shared,
            template=self.robot.health.templates.get((spec.topic, spec.node), b""),
            provider=spec.node if awaited or (own and not own.has_failed) else "",
        )

    @property
    def _original(self) -> str:
        """Return the gone node that may take consumers over; none if its row says why it cannot."""
        node = self.incident.faulty_node
        gone = self.incident.killed is not None or self.accusation.kind is Kind.NODE_GONE
        row = self.robot.health.rows[self.spec.topic].get(node)
        unfit = row is not None and row.state is PublisherState.UNKNOWN and row.detail != ""
        return node if gone and not (self.spec.gated or unfit) else ""

    def _bridge(self) -> float:
        """Return the silence in s after which a substitute that stands by fills in; 0: never.

        It does while the original may speak. Not on a shared topic, where somebody else is heard;
        nor from another computer, where what is late may be the link.
        """
        spec, robot = self.spec, self.robot
        if robot.maintained or self.state not in (State.WELL, State.RETURNING, *SUBSTITUTED):
            return 0.0
        here = not robot.som.hosts or self.substitute.host == robot.host_of(spec.node)
        alone = len(robot.som.of_topic(spec.topic)) == 1
        fits = here and alone and self.spec.policy.substitutes and self.substitute.whole
        return (spec.bridges or 0.0) * (spec.period or 0.0) if fits else 0.0

    def validate(self) -> None:
        """Raise ShsaError if something is not as it must be."""
        name = self.spec.name
        if bool(self.node) != (self.substitute.plan is not None):
            raise ShsaError(f"{name}: a process without a plan, or the other way round")
        if any((self.state, each) not in self._transitions for each in self.timers):
            raise ShsaError(f"{name}: {self.state} with the timers {set(self.timers)}")
        if self.state in WAITING and Trigger.RETRY not in self.timers:
            raise ShsaError(f"{name}: {self.state}, and nothing will ever be tried again")
        if self.state is State.HEALED and not self.substitute.computes:
            raise ShsaError(f"{name}: healed without a substitute")
        if self.incident.faulty_node != self.accusation.node:
            raise ShsaError(f"{name}: its incident blames another node than it accuses")

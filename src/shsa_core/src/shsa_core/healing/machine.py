"""The reconfigurator's decisions: events in, commands out (Section IV-C of the paper).

An event is handled by those that it concerns: the services that it is about, and those whose
substitutes read what it changes. What is known of the rest stays as it is, so that a decision costs
the same on a large robot.
"""
from dataclasses import replace
from typing import Any, Callable, Collection, Dict, List, Optional, Tuple, Type

from shsa_core import dispatch
from shsa_core.codegen.plans import Plan
from shsa_core.errors import ModelError
from shsa_core.healing import events
from shsa_core.healing.events import Command, Event, FailureSeen, Level, Log
from shsa_core.healing.host_events import HostLost, HostSeen
from shsa_core.healing.hearing import Hearing
from shsa_core.healing.incident import Incident
from shsa_core.healing.records import RestartedNode
from shsa_core.healing.settings import Settings
from shsa_core.healing.upkeep import is_shared
from shsa_core.model.kinds import Kind
from shsa_core.model.names import full_name
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import PublisherState

TELLING = (events.Log, events.ShowIncident, events.ShowSom)
"""What only tells people comes after what acts: a line of the log takes as long as a takeover."""


class Reconfigurator(Hearing):
    """Heals every needed service of a SOM.

    Args:
        ontology: the relations to search.
        som: the services; may change later by SomChanged.
        settings: times and limits.
        namespace: where healing runs: relative names are in it, and so are the substitutes' names,
            which are never used twice.
        dry_run: whether every service's policy counts as `advise`: nothing is killed or started.
        restarts: whether nodes may be started again; else their policy counts as the rest of it.
        host: the name in the SOM of the computer that we run on; empty: not known.
    """

    def __init__(
        self,
        ontology: Ontology,
        som: Som,
        settings: Settings = Settings(),
        namespace: str = "/",
        dry_run: bool = False,
        restarts: bool = True,
        host: str = "",
    ) -> None:
        super().__init__(ontology, som, settings, namespace, dry_run, restarts, host)
        self._handlers: Dict[Type[Event], Callable[[Any], List[Command]]] = dispatch.table(
            Event,
            {
                events.Started: self._started,
                events.Prepared: self._prepared,
                events.ShuttingDown: self._shutting_down,
                events.LaunchEnding: self._launch_ending,
                events.FailureSeen: self._failure_seen,
                events.HealthSeen: self._health_seen,
                events.SomChanged: self._som_changed,
                events.ModelsReloaded: self._models_reloaded,
                events.NodeLearned: self._node_learned,
                events.NodeCameUp: self._node_came_up,
                events.NodeFound: self._node_found,
                events.NodeLeft: self._node_left,
                events.NodeUnregistered: self._node_unregistered,
                events.ProcessUntouchable: self._process_untouchable,
                events.SubstituteStarted: self._substitute_started,
                events.ProcessExited: self._process_exited,
                events.ProcessSilent: self._process_silent,
                events.ProcessHeard: self._process_heard,
                events.ProcessHung: self._process_hung,
                events.SubstituteRequested: self._requested,
                events.NodeRestarted: self._node_restarted,
                events.RestartFailed: self._restart_failed,
                events.StarterEnded: self._starter_ended,
                events.Released: self._released,
                events.CalibrationsHeard: self._calibrations_heard,
                HostSeen: self._host_seen,
                HostLost: self._host_lost,
                events.Idle: self._idle,
                events.Tick: self._tick,
            },
        )

    def handle(self, event: Event) -> List[Command]:
        """What is to be done about `event`."""
        if self._over:
            return []  # nobody would stop what is started now
        self._time = max(self._time, event.time)  # a failure is heard after it was seen
        self._forget_ended()
        commands = self._handlers[type(event)](event)
        commands += self._start_waiting()
        commands += self._settle()
        commands += [] if self._over else self._refill()
        commands += self._watch()
        commands = self._strays.passed(self._time, commands)
        shown = self._substitutions.change()
        if shown is not None:
            commands.insert(0, shown)  # first: it decides who publishes
        commands[:0] = self._write_down()
        states = self._states.change()
        if states is not None:
            commands.append(states)
        return sorted(commands, key=lambda command: isinstance(command, TELLING))

    @property
    def plans_ahead(self) -> bool:
        """Whether there are plans to make before they are needed: Idle makes one."""
        return self._planner.plans.stale

    @property
    def deadline(self) -> Optional[float]:
        """When a Tick is due, in s; None: none is."""
        dues = (
            self._agenda.next(),
            self._starts.earliest(self._pool.deadline),
            self._starts.deadline,
            self._kills.deadline,
            self._acquaintance.deadline,
            self._untold.next(),
            self._asked.next(),
            self._nodes.deadline,
            self._hosts.deadline,
        )
        return min((due for due in dues if due is not None), default=None)

    def needed(self) -> Tuple[Service, ...]:
        """The services that are healed when they fail."""
        return self._som.needed()

    def find(self, name: str) -> Service:
        """The service of a name, a topic or a property; a needed one first.

        A relative topic is one in our namespace. Raises ModelError if there is none.
        """
        som = self._som
        topic = full_name(name, self._namespace)
        found = [som.services[name]] if name in som.services else list(som.of_topic(topic))
        found += [source.service for source in som.of_property(name)]
        if not found:
            known = ", ".join(f"{each.name} ({each.topic})" for each in som)
            raise ModelError(name, f"the SOM has no such service or topic; it has {known}")
        return min(found, key=lambda service: not service.needed)

    def explain(self, name: str, without: Collection[str] = (), method: str = "") -> Plan:
        """What would be done if the node of a service failed. Acts on nothing. Raises ShsaError."""
        excluded = [self._som.known_name(each, self._namespace) for each in without]
        plan = self._planner.explain(self.find(name), excluded, method)
        return replace(plan, errors=self._planner.errors(plan))

    def incident(self, service: str) -> Optional[Incident]:
        """The open incident of a service."""
        healing = self._healings.get(service)
        return healing.incident if healing else None

    def _started(self, event: events.Started) -> List[Command]:
        """Take up what a former reconfigurator has left, and stop the rest.

        Its names are not used again. A user's node may have a name that begins like that: it is
        none of our business.
        """
        if event.preparing:
            self._starts.hold(event.time)
        commands = self._take_up(event)
        for node in filter(self.names.avoid, event.strangers):
            text = f"{node} is left alone: it is named as a substitute, but is not known to be one."
            commands.append(Log(Level.WARN, f"{text} If it was left behind: rosnode kill {node}"))
        for node in filter(self.names.avoid, event.leftovers):
            commands.append(Log(Level.WARN, f"Stopping orphaned substitute {node}."))
            commands += self._end_orphan(node)
        return commands

    def _prepared(self, event: events.Prepared) -> List[Command]:
        self._starts.release()
        return []

    def _shutting_down(self, event: events.ShuttingDown) -> List[Command]:
        """End every substitute, and the nodes that whoever ends us has started first."""
        self._over = True
        self._records.forget()
        self._starts.forget()
        ended: List[Command] = [events.StopSubstitute(node) for node in self.substitutes]
        return ended + [events.StopNode(node) for node, ours in self._with_us.items() if ours]

    def _launch_ending(self, event: events.LaunchEnding) -> List[Command]:
        """What stops on purpose is not healed."""
        self._ending = True
        self._starts.forget()
        return []

    def _som_changed(self, event: events.SomChanged) -> List[Command]:
        old, self._som = self._som, self._as_told(event.som)
        self._planner.som = som = self._som
        commands: List[Command] = []
        for name in [name for name in old.services if name not in som.services]:
            commands += self._remove(old.services[name])
        for service in som:
            before = old.services.get(service.name)
            if before is None:
                self._add(service)
            elif before.topic != service.topic:
                commands += self._remove(before)
                self._add(service)
            elif before != service or is_shared(old, service) != is_shared(som, service):
                commands += self._change(service)
        for name in list(self._concern.kept):
            commands += self._ask(name, lambda healing, now: healing.reconsider(now))
        return commands + (self._rehost() if old.hosts or som.hosts else [])

    def _models_reloaded(self, event: events.ModelsReloaded) -> List[Command]:
        """Plans follow the new models; what runs goes on."""
        planner = self._planner_of(event.ontology)
        planner.plans.change((), self._availability.services.values())
        self._planner = planner
        return self._som_changed(events.SomChanged(event.time, event.som))

    def _node_learned(self, event: events.NodeLearned) -> List[Command]:
        self._acquaintance.learned(event)
        self._nodes.learned(event)
        self._unsettle_node(event.node)
        return []

    def _node_came_up(self, event: events.NodeCameUp) -> List[Command]:
        commands: List[Command] = []
        for name in self._concern.blaming(event.node):
            commands += self._ask(name, lambda healing, now: healing.came_up(now))
        return commands

    def _node_found(self, event: events.NodeFound) -> List[Command]:
        strained = self._hosts.strained(self._where.host_of(event.node))
        commands, over = self._kills.found(event, strained)
        return commands + self._killed([over] if over else [])

    def _node_left(self, event: events.NodeLeft) -> List[Command]:
        commands, over = self._kills.left(event)
        return self._killed([over] if over else []) + commands

    def _node_unregistered(self, event: events.NodeUnregistered) -> List[Command]:
        commands: List[Command] = []
        for name in self._concern.blaming(event.node):
            commands += self._ask(name, lambda healing, now: healing.left_in_order())
        return commands

    def _process_untouchable(self, event: events.ProcessUntouchable) -> List[Command]:
        over = self._kills.untouchable(event)
        return self._killed([over] if over else [])

    def _substitute_started(self, event: events.SubstituteStarted) -> List[Command]:
        return self._ask_of(event.node, lambda healing, now: healing.started(event))

    def _process_exited(self, event: events.ProcessExited) -> List[Command]:
        self._starts.over(event.node)
        if event.node in self._pool.nodes:
            commands = self._pool.died(event.time, event.node, event.detail)
            self._substitutions.set(event.node, None)
        else:
            commands = self._ask_of(event.node, lambda h, now: h.exited(now, event.detail))
        if self._strays.host(event.node):  # nobody there needs to be told to end it
            commands = [each for each in commands if each != events.StopSubstitute(event.node)]
        self._strays.ended(event.node)
        return commands

    def _process_silent(self, event: events.ProcessSilent) -> List[Command]:
        """Who gives no sign of life is not set to work, and is replaced if it was just now."""
        if event.node in self._pool.nodes:
            self._pool.silent(event.node)
            return []
        return self._ask_of(event.node, lambda healing, now: healing.process_silent(now))

    def _process_heard(self, event: events.ProcessHeard) -> List[Command]:
        self._pool.heard(event.node)
        self._starts.over(event.node)
        return []

    def _process_hung(self, event: events.ProcessHung) -> List[Command]:
        if event.node in self._pool.nodes:
            self._substitutions.set(event.node, None)
            return self._pool.hung(event.time, event.node)
        return self._ask_of(event.node, lambda healing, now: healing.process_hung(now))

    def _requested(self, event: events.SubstituteRequested) -> List[Command]:
        incident = self.incident(event.service)
        if incident is not None:
            return [events.ShowIncident(incident)]
        service = self._som.services.get(event.service)
        if service is None:
            return []
        originals = self._availability.originals(self._som, service)
        healthy = [row for row in originals if row.state is PublisherState.HEALTHY]
        node = healthy[0].publisher if healthy else service.node
        last_good = healthy[0].last_good if healthy else None
        why = "somebody asked for a substitute"
        failure = FailureSeen(
            event.time,
            service.name,
            service.topic,
            node,
            Kind.REQUESTED,
            why,
            last_good,
            event.last_message,
        )
        return self._failure_seen(failure)

    def _node_restarted(self, event: events.NodeRestarted) -> List[Command]:
        if event.node in self._nodes.substitutes:
            return []  # none of ours is ever started again
        self._with_us[event.node] = event.with_us
        self._records.put(RestartedNode(event.node, event.with_us))
        return []

    def _restart_failed(self, event: events.RestartFailed) -> List[Command]:
        self._nodes.end_restart(event.node)
        commands: List[Command] = []
        for name in self._concern.blaming(event.node):
            commands += self._ask(
                name, lambda healing, now: healing.restart_failed(now, event.node, event.detail)
            )
        return commands

    def _starter_ended(self, event: events.StarterEnded) -> List[Command]:
        """A node that was started again lives no longer than whoever started it first."""
        return [events.StopNode(event.node)] if self._forget_restarted(event.node) else []

    def _released(self, event: events.Released) -> List[Command]:
        return self._ask(event.service, lambda healing, now: healing.released(now))

    def _calibrations_heard(self, event: events.CalibrationsHeard) -> List[Command]:
        """Note what the substitutes start with; who computes already, as hot ones do, follows."""
        for service, program in event.removed:
            self._calibrations.leave(service, program)
        taken = [row.service for row in event.rows if self._calibrations.take(row)]
        commands: List[Command] = []
        for name in dict.fromkeys(taken):
            if name in self._healings and self._healings[name].node:
                commands += self._ask(name, lambda healing, now: [])
        return commands

    def _idle(self, event: events.Idle) -> List[Command]:
        """Make one plan ahead; who follows it follows the new one."""
        name = self._planner.plans.step()
        if name is None:
            return []
        service = self._som.services[name]
        if self._pool.serves(service):
            self._stand_by(service, self._planner.plans.plan(name))
        return self._ask(name, lambda healing, now: healing.replan(now))

    def _tick(self, event: events.Tick) -> List[Command]:
        commands, over = self._kills.tick(event.time)
        commands += self._killed(over)
        for node in self._kills.again(event.time):
            commands += self._kill_again(node)
        commands += self._acquaintance.tick(event.time) + self._hosts_settled(event.time)
        for name in self._untold.pop_due(event.time):
            missed = self._missed_failure(event.time, name)
            commands += [] if missed is None else self._failure_seen(missed)
        commands += self._monitors_lost(event.time)
        unheard = self._nodes.unheard(event.time)
        commands += self._health_seen(unheard) if unheard else []
        for name in self._agenda.pop_due(event.time):
            commands += self._ask(name, lambda healing, now: healing.tick(now))
        return commands

"""Goes on with what a former reconfigurator has left.

Nothing in its records is believed that does not fit: a process counts if it is known to run, a
program if it is a plan of the models as they are now, a health until the monitor tells another.
"""
from dataclasses import replace
from math import inf
from typing import List

from shsa_core.healing import events, hearing
from shsa_core.healing.core import Core
from shsa_core.healing.events import Command, Log, ShowIncident
from shsa_core.healing.health import MISSED
from shsa_core.healing.incident import WAITING, State, Trigger
from shsa_core.healing.records import Counters, Fate, Healthy, NodeRecord, ServiceRecord
from shsa_core.healing.service import ServiceMachine
from shsa_core.healing.settings import ANSWER_S
from shsa_core.model.health import PublisherHealth, PublisherState
from shsa_core.model.kinds import Policy
from shsa_core.model.log import Level
from shsa_core.planning.planner import program_of
from shsa_core.planning.pool import IdleProcess
from shsa_core.planning.settings import START_S


def started(core: Core, event: events.Started) -> List[Command]:
    """Take up what a former reconfigurator has left, and end the rest.

    Its names are not used again. A user's node may have a name that begins like that: it is none of
    our business.
    """
    robot, names = core.robot, core.robot.names
    if event.preparing:
        core.processes.hold_starts(max(core.processes.starts.held_until, event.time + START_S))
    for node in event.running:
        if names.avoid(node):
            robot.health.substitutes.add(node, event.running)
        else:
            robot.restarted.add(node)
    commands = _take_up(core, event)
    kept = {*core.processes.nodes, *robot.restarted}
    stopped = {each.node for each in commands if isinstance(each, events.StopNode)}
    orphans = [events.StopNode(node) for node in event.running if node not in kept | stopped]
    for each in (*orphans, *map(events.ClearNode, filter(names.avoid, event.leftovers))):
        commands += [Log(Level.WARN, f"Stopping orphaned substitute {each.node}."), each]
    if event.records:
        incidents = sum(each.state is not State.WELL for each in core.services.values())
        working, idle = len(core.processes.substituted), len(core.processes.pool.processes)
        text = f"{incidents} incidents, {working} substitutes, {idle} idle processes"
        commands.append(Log(Level.INFO, f"Taking up what was left behind: {text}."))
    for node in filter(names.avoid, event.strangers):
        text = f"{node} is left alone: it is named as a substitute, but is not known to be one."
        commands.append(Log(Level.WARN, f"{text} If it was left behind: rosnode kill {node}"))
    return commands


def _take_up(core: Core, event: events.Started) -> List[Command]:
    robot, services = core.robot, core.robot.som.services
    health, processes = robot.health, core.processes
    of = lambda kind: [each for each in event.records if isinstance(each, kind)]
    for counters in of(Counters):
        robot.incidents = max(robot.incidents, counters.incidents)
        robot.names.next = max(robot.names.next, counters.names)
    for record in of(NodeRecord):
        core.nodes.trust(record.node, record.trust)
    for each in of(ServiceRecord):  # all of them, before any can end a process that it shares
        row, service = each.substitution, services.get(each.service)
        if row is not None:
            health.substitutes.add(row.node)
            if service is not None:
                processes.take_up(service, row.node, row.shared)
    commands = [command for record in of(Healthy) for command in _recall(core, record)]
    commands += core.settle()
    for idle in of(IdleProcess):
        lacking = not idle.host and processes.pool.deadline < inf
        if lacking and idle.node in event.running:
            processes.add_idle(idle)
    for record in of(ServiceRecord):
        commands += _take_up_service(core, event, record)
    return commands


def _recall(core: Core, record: Healthy) -> List[Command]:
    """Count a publisher as well that was so; not a substitute that has ended."""
    robot, node = core.robot, record.publisher
    ours = node in robot.health.substitutes
    if core.robot.names.avoid(node) and not ours:
        return []
    since = record.since
    row = PublisherHealth(record.topic, node, PublisherState.HEALTHY, since, since, since)
    row = replace(row, last_message=record.template, uri=record.uri)
    robot.health.recall(row)
    if ours:
        return []
    core.unsettle(core.concerned(record.topic, node))
    return hearing.acquaint(core, node, row)


def _take_up_service(core: Core, event: events.Started, record: ServiceRecord) -> List[Command]:
    incident, row = record.incident, record.substitution
    spec = core.robot.som.services.get(record.service)
    if spec is None:
        if incident is not None and incident.ended is None:
            why = f"{incident.service} is not in the SOM any more."
            incident = replace(incident, state=State.ENDED, ended=event.time, detail=why)
        return [] if incident is None else [ShowIncident(incident)]
    robot, templates = core.robot, core.robot.health.templates
    if row is not None and row.template:
        templates.setdefault((spec.topic, spec.node), row.template)
    if incident is not None and incident.last_good is not None:
        templates.setdefault((incident.topic, incident.faulty_node), b"")
    if incident is not None and incident.killed is None:
        node = incident.faulty_node
        if incident.kind in MISSED and robot.host_of(node):  # it may have been cut off, and be back
            robot.health.stranded.add((incident.topic, node))
    if row is not None:
        robot.calibrations.recall(record.service, program_of(row), row.outputs)
    runs = row is not None and row.node in event.running
    return core.ask(record.service, lambda service: _go_on(service, record, runs))


def _go_on(service: ServiceMachine, record: ServiceRecord, runs: bool) -> List[Command]:
    """Go on with a service as a record says; `runs`: the substitute's process does."""
    spec, robot, substitute = service.spec, service.robot, service.substitute
    incident, row = record.incident, record.substitution
    shown: List[Command] = [] if incident is None else [ShowIncident(incident)]
    ended = incident is not None and incident.state is State.ENDED
    if record.topic != spec.topic:  # the SOM has moved it
        left = [] if row is None else service.processes.leave(spec.name, row.node)
        return [*shown, *left] if ended else left
    if ended:
        incident = None  # it is shown: it may not have been written to the log
    if incident is not None:
        service.incident = incident
        service.accusation = accused = service.nodes.accuse(spec, incident.faulty_node, record.kind)
        accused.decision, accused.back = incident.decision, incident.state is State.RETURNING
        if incident.killed is not None:
            accused.fate = Fate.NONE
        elif record.fate is not Fate.KILLED:  # else it may be another process by now
            accused.fate = record.fate
    commands = substitute.drop() + shown  # it may stand by for us already
    service.last_message, plan = row.last_message if row else record.last_message, None
    if row is not None:
        advises = spec.policy is Policy.ADVISE
        plan = None if advises else robot.planner.recall(spec, row)
        if plan is not None:
            substitute.take_up(row, plan, robot.time if incident is None else incident.detected)
    if row is None or (plan is not None and runs):
        _set_timer(service)
        return commands
    why = "its process died"
    if plan is None:
        why = "what it computes does not fit ontology and SOM, or the policy, any more"
        substitute.node, substitute.shared = row.node, row.shared
    text = f"{spec.topic}: the substitute that was left behind is of no use: {why}."
    commands += [*substitute.failed(False), Log(Level.WARN, text)]
    if service.state is State.HEALED:
        commands += service.step(state=State.HEALING, first_message=None, last_good=robot.time)
    _set_timer(service)
    fired = [] if Trigger.REPLAN in service.timers else service.fire(Trigger.SUBSTITUTE_FAILED)
    return commands + fired


def _set_timer(service: ServiceMachine) -> None:
    """See to it that something happens in every state, once the monitors had a moment to tell."""
    state, now = service.state, service.robot.time
    if state is State.HEALING and service.node:
        service.timers[Trigger.LATE] = now + START_S
    elif state is State.RETURNING:
        hold_off = service.nodes.hold_off(service.incident.faulty_node)
        service.timers[Trigger.STEADY] = now + max(START_S, hold_off)
    elif state not in (State.WELL, State.HEALED):
        service.timers[Trigger.REPLAN] = now + ANSWER_S
    if state in WAITING:
        service.timers[Trigger.RETRY] = now + START_S

"""Hears the monitors, and which computers are there.

A row of health that turns failed is the failure; one that somebody tells of besides is the same
fact. A node's silence is found sooner than the loss of its computer: what was decided in between is
looked at again. The monitor there is then asked for its whole table; if that does not come, those
that it watched count as silent.
"""
from typing import Dict, Iterable, List, Optional, Tuple

from shsa_core.healing.core import Core
from shsa_core.healing.events import AskMonitor, Command, FailureSeen, HealthSeen, HostLost
from shsa_core.healing.events import HostSeen, Log
from shsa_core.healing.health import MISSED
from shsa_core.healing.settings import ANSWER_S
from shsa_core.model.health import Key, PublisherHealth
from shsa_core.model.kinds import Kind, OnPartition
from shsa_core.model.log import Level


def failed(core: Core, event: FailureSeen, told: bool = False) -> List[Command]:
    """Have a service decide about a failure; `told`: the table of health tells of it.

    Else somebody does, who is not heeded if the table has told of it, or of what came after it.
    """
    robot = core.robot
    topic, publisher = event.topic, event.publisher
    served = core.processes.served(publisher)
    substituted = _substituted(core, topic, served) if served else ()
    named = event.service or (substituted[0] if substituted else "")
    som = robot.som
    service = som.services.get(named) if named else som.service_of(topic, publisher)
    if service is None:
        return []
    name = service.name
    if publisher in robot.health.substitutes and name not in served:
        return []  # it was a substitute, long ago
    if event.kind is Kind.NO_VALUE and not served:
        return []  # only a substitute of ours can tell that of itself
    if not event.detail:
        text = f"{topic}: a failure of {publisher or 'nobody'} is told without saying what was seen"
        return [Log(Level.WARN, f"{text}. Nothing is healed without evidence.")]
    # A node that is asked about does well, and so does a substitute that tells of its law.
    well = event.kind in (Kind.REQUESTED, Kind.NO_VALUE)
    if not (told or well or robot.health.note(event)):
        return []
    core.unsettle([name, *core.concerned(topic, publisher)])
    if event.kind is Kind.NODE_GONE and not told:  # else its row has done so
        core.unsettle_node(publisher)
    if not service.needed:
        why = event.detail.rstrip(".")
        return [Log(Level.WARN, f"{topic} failed: {why}. It is not needed: nothing is done.")]
    host = robot.host_of(publisher or service.node) if event.kind in MISSED else ""
    if host:  # it is not known yet whether the computer is lost
        robot.computers.doubt(host, event.time)
    return core.ask(name, lambda each: each.failed(event))


def _substituted(core: Core, topic: str, served: Tuple[str, ...]) -> Tuple[str, ...]:
    """Return the services of a topic that the substitutes in a process work for."""
    services = core.robot.som.services
    if len(served) == 1:  # it may have advertised other topics before it was set to work
        return served
    return tuple(name for name in served if services[name].topic == topic)


def health_seen(core: Core, event: HealthSeen) -> List[Command]:
    """Take over what a monitor tells, and have those decide whom it concerns."""
    if event.whole:
        core.asked.set(core.robot.computers.name(event.host), None)
    return _changed(core, *core.robot.health.heed(event))


def _changed(core: Core, keys: Iterable[Key], failures: List[FailureSeen]) -> List[Command]:
    robot = core.robot
    commands: List[Command] = []
    concerned: Dict[str, None] = {}
    judged: Dict[str, None] = {}
    for topic, publisher in keys:
        served = core.processes.served(publisher)
        if served:
            concerned.update(dict.fromkeys(_substituted(core, topic, served)))
        elif publisher not in robot.health.substitutes:
            services = core.concerned(topic, publisher)
            concerned.update(dict.fromkeys(services))
            core.unsettle(services)
            accusers = core.nodes.accusers(publisher)
            judged.update((name, None) for name in accusers if name in robot.indexes.kept)
            commands += acquaint(core, publisher, robot.health.row((topic, publisher)))
    if failures:
        commands += core.settle()  # what has failed as well is no input
    for failure in failures:
        commands += failed(core, failure, told=True)
    commands += core.ask_all(concerned, lambda each: each.changed())
    return commands + core.ask_all(judged, lambda each: each.replan())


def look_again(core: Core) -> List[Command]:
    """Heal what has failed before it was needed, as the SOM is another one now."""
    robot = core.robot
    commands: List[Command] = []
    for service in robot.som.needed():
        rows = robot.health.originals(robot.som, service)
        well = any(row.is_well for row in rows)
        for row in () if well or core.incident(service.name) else rows:
            if row.has_failed and row.publisher not in robot.health.doomed:
                commands += failed(core, robot.health.failure(row), told=True)
    return commands


def acquaint(core: Core, node: str, row: Optional[PublisherHealth]) -> List[Command]:
    """Learn which process a node is that is well; forget that of one that is gone."""
    robot = core.robot
    if row is None or (row.has_failed and row.kind is Kind.NODE_GONE):
        robot.identities.went(node)
        core.unsettle_node(node)
    elif row.is_well:
        # Only the nodes that the SOM names are learned: anybody registers other names.
        if any(each.node == node for each in robot.som.of_topic(row.topic)):
            return robot.identities.came_up(node, row.topic)
    return []


def tick(core: Core, time: float) -> List[Command]:
    """Act on monitors that should have told something by now, and have not."""
    robot = core.robot
    commands: List[Command] = []
    for host in core.asked.pop_due(time):
        why = f"{host} is lost, and its monitor: {robot.computers.lost(host).rstrip('.')}"
        processes = core.processes.nodes
        elsewhere = [node for node in processes if robot.host_of(node) != host]
        commands += _changed(core, *robot.health.lose_monitor(time, host, why, elsewhere))
        working = core.processes.working_on(host)  # what was heard so far is not now
        commands += core.ask_all(working, lambda each: each.rehost())
    missed = robot.health.missed(time)
    return commands + ([] if missed is None else health_seen(core, missed))


def ask_monitor(core: Core, host: str, due: Optional[float] = None) -> List[Command]:
    """Ask the monitor of a computer for its whole table; `due`: it is lost if it is silent then."""
    in_som = core.robot.computers.in_som(host)
    known = core.robot.health.has_monitor(in_som)
    core.asked.set(host, due if known else None)
    return [AskMonitor(in_som)] if known else []


# Computers.


def host_seen(core: Core, event: HostSeen) -> List[Command]:
    """Note that a computer is there, and what it has to do."""
    robot = core.robot
    computers, host = robot.computers, robot.computers.name(event.host)
    if host and host not in robot.som.hosts:
        return []
    lost = bool(computers.lost(host))
    computers.seen(event.time, host, event.load, event.cores, event.sent + event.received)
    commands = _decide_anew(core, host)  # a silence may be the node's own by now
    if lost:
        core.unsettle(service.name for service in robot.on(host))
        commands += [Log(Level.INFO, f"{host} is back."), *ask_monitor(core, host)]
    return commands


def _decide_anew(core: Core, host: str) -> List[Command]:
    """Have those services decide that wait for their computer."""
    waiting = [s.name for s in core.robot.on(host) if s.on_partition is OnPartition.WAIT]
    healing = core.robot.indexes.healing
    return core.ask_all(filter(healing.__contains__, waiting), lambda each: each.replan())


def host_lost(core: Core, event: HostLost) -> List[Command]:
    """Note that a computer is not heard any more."""
    robot, processes = core.robot, core.processes
    host = robot.computers.name(event.host)
    if host not in robot.som.hosts or not robot.computers.lose(host, event.time, event.detail):
        return []
    why = f"{host} is lost: {event.detail.rstrip('.')}"
    commands: List[Command] = [Log(Level.WARN, f"{why}.")]
    for service in robot.on(host):
        core.unsettle([service.name])
        if service.needed and service.event_driven:
            text = f"Whether anybody publishes {service.topic} cannot be told by its silence"
            commands.append(Log(Level.WARN, f"{text}: it is not healed while {host} is lost."))
    commands += core.settle()
    commands += core.nodes.computer_lost(host, why)
    _place_warm(core)
    commands += core.ask_all(processes.working_on(host), lambda each: each.rehost())
    commands += _decide_anew(core, host)
    return commands + ask_monitor(core, host, event.time + ANSWER_S)


def rehost(core: Core) -> List[Command]:
    """Move what stands by to where it belongs: other computers count now."""
    _place_warm(core)
    commands = core.ask_all(core.processes.substituted, lambda each: each.rehost())
    return commands + core.ask_all(core.robot.indexes.stuck, lambda each: each.replan())


def _place_warm(core: Core) -> None:
    robot = core.robot
    for name in list(core.processes.pool.hosts):
        core.processes.stand_by(robot.som.services[name], robot.planner.plans.plan(name))

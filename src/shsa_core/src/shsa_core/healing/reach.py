"""Reacts to a computer of the robot that is lost, and to one that is back.

A computer is lost when its agent is not heard. Only then it can be told from a node's own failure,
and a node's silence is found sooner: what was decided in between is looked at again. When the
computer is back, the kills go on that could not be finished, and its nodes are judged as any that
return.
"""
from typing import List

from shsa_core.healing import hearing
from shsa_core.healing.core import Core
from shsa_core.healing.events import Command, HostLost, HostSeen, Log
from shsa_core.healing.settings import ANSWER_S
from shsa_core.model.kinds import OnPartition
from shsa_core.model.log import Level


def host_seen(core: Core, event: HostSeen) -> List[Command]:
    """Note that a computer is there, and what it has to do."""
    robot = core.robot
    computers, host = robot.computers, robot.computers.name(event.host)
    if host and host not in robot.som.hosts:
        return []
    heard, lost = computers.heard(host), bool(computers.lost(host))
    back = computers.seen(event)
    commands: List[Command] = []
    if lost:
        commands.append(Log(Level.INFO, f"{host} is back."))
        for service in robot.on(host):
            core.unsettle([service.name])
    if back:
        commands += core.deliver(core.nodes.excuse(host, heard))
    commands += core.deliver(core.nodes.computer_heard(host))
    lacking = [name for name in robot.indexes.stuck if core.services[name].lacks_room]
    commands += core.ask_all(lacking, lambda each: each.replan())
    for name in list(robot.indexes.kept):  # its silence may be its own by now
        waited = robot.som.services[name]
        if waited.on_partition is OnPartition.WAIT and computers.name(waited.host) == host:
            commands += core.ask(name, lambda each: each.replan())
    return commands + (hearing.ask_monitor(core, host) if lost else [])


def host_lost(core: Core, event: HostLost) -> List[Command]:
    """Note that a computer is not heard any more."""
    robot, processes = core.robot, core.processes
    host = robot.computers.name(event.host)
    heard = robot.computers.heard(host)
    if host not in robot.som.hosts or not robot.computers.lose(event):
        return []
    why = f"{host} is lost: {event.detail.rstrip('.')}"
    commands: List[Command] = [Log(Level.WARN, f"{why}.")]
    for service in robot.on(host):
        core.unsettle([service.name])
        if service.needed and service.event_driven:
            text = f"Whether anybody publishes {service.topic} cannot be told by its silence"
            commands.append(Log(Level.WARN, f"{text}: it is not healed while {host} is lost."))
    commands += core.settle() + core.deliver(core.nodes.excuse(host, heard))
    commands += core.deliver(core.nodes.computer_lost(host, why))
    for node in processes.pool.on(host):
        commands += processes.drop_idle(node)
    _place_warm(core)
    commands += core.ask_all(processes.working_on(host), lambda each: each.host_lost(why))
    for service in robot.on(host):
        if service.on_partition is OnPartition.WAIT and service.needed:
            commands += core.ask(service.name, lambda each: each.replan())
    return commands + hearing.ask_monitor(core, host, event.time + ANSWER_S)


def rehost(core: Core) -> List[Command]:
    """Move what stands by to where it belongs: other computers count now."""
    robot = core.robot
    _place_warm(core)
    commands = core.ask_all(core.processes.substituted, lambda each: each.rehost())
    stuck = robot.indexes.stuck
    return commands + core.ask_all(stuck, lambda each: each.replan())


def _place_warm(core: Core) -> None:
    """Want idle processes where the plans of the warm services are placed now."""
    robot = core.robot
    for name in list(core.processes.pool.plans):
        core.processes.stand_by(robot.som.services[name], robot.planner.plans.plan(name))

"""The states of a service as a table, and how an incident begins, changes and ends.

docs/reference/ros.md shows this table.
"""
from dataclasses import replace
from typing import Iterable, List, Tuple

from shsa_core.healing import repair
from shsa_core.healing.events import Command, Log, ShowIncident
from shsa_core.healing.incident import SUBSTITUTED, WAITING, WELL, Incident, State, Trigger
from shsa_core.healing.node import Accusation
from shsa_core.healing.records import Fate
from shsa_core.healing.service import Action, Failure, ServiceMachine, Transitions
from shsa_core.model.kinds import Kind
from shsa_core.model.log import Level


def begin(service: ServiceMachine, failure: Failure) -> List[Command]:
    """Open an incident, and heal."""
    assert failure is not None
    spec, robot, node = service.spec, service.robot, failure.publisher
    service.timers.clear()
    service.substitute.forget()
    service.substitute.working_since = failure.good_until
    service.pauses = 0
    service.accusation = service.nodes.accuse(spec, node, failure.kind)
    service.nodes.failed(failure.time, spec, node, failure.kind, soon=False)
    robot.incidents += 1
    service.incident = Incident(
        id=robot.incidents,
        service=spec.name,
        topic=spec.topic,
        properties=spec.properties,
        faulty_node=node,
        kind=failure.kind,
        evidence=failure.detail,
        detail=failure.detail,
        detected=failure.time,
        last_good=failure.last_good,
    )
    text = f"{spec.topic} failed: {failure.detail.rstrip('.')}."
    return [Log(Level.WARN, text), ShowIncident(service.incident), *replan(service, failure)]


def replan(service: ServiceMachine, _: Failure) -> List[Command]:
    """Heal by what is known now; what was asked for is over if the node goes on."""
    accused, killed = service.accusation, service.incident.killed
    asked = accused.kind is Kind.REQUESTED and killed is None
    commands = [] if asked and accused.fate is Fate.NONE else repair.heal(service)
    if asked and accused.fate in (Fate.NONE, Fate.KEPT):
        commands += service.substitute.rest(service.spec) + close(service, service.incident.detail)
    return commands


def still_failing(service: ServiceMachine, failure: Failure) -> List[Command]:
    """Judge a node that failed once more, or another one beside it."""
    assert failure is not None
    nodes, node = service.nodes, failure.publisher
    commands: List[Command] = [service.log(f"{node} failed again: {failure.detail}.")]
    former = service.incident.faulty_node
    accusation = nodes.accuse(service.spec, node, failure.kind)
    if node != former:
        replaced = node != service.spec.node  # the node of the SOM is to give it
        commands += service.judge(accusation, repair.search(service)[0], replaced)
        if not (accusation.kept and accusation.heard):  # it is killed, or silent
            nodes.acquit(service.spec, node)
            return commands
        commands += blame(service, node, failure.kind)
    return commands + repair.heal(service)


def blame(service: ServiceMachine, node: str, kind: Kind) -> List[Command]:
    """Blame a node, in place of another that the incident blames."""
    nodes, former = service.nodes, service.incident.faulty_node
    service.accusation = nodes.accuse(service.spec, node, kind)
    if node == former:
        return []
    service.incident = replace(service.incident, faulty_node=node)
    nodes.acquit(service.spec, former)
    return service.step()


def failed_again(service: ServiceMachine, failure: Failure) -> List[Command]:
    """Go on after the node failed within its hold-off."""
    assert failure is not None
    spec, robot, node = service.spec, service.robot, failure.publisher
    commands = blame(service, node, failure.kind)
    accusation = service.accusation
    service.nodes.failed(failure.time, spec, node, failure.kind, soon=True)
    service.timers.clear()
    detail = f"{node} failed again: {failure.detail}"
    healed = service.substitute.computes  # else to heal is to search and judge
    judged = service.judge(accusation, repair.search(service)[0]) if healed else []
    commands += [service.log(f"{detail}."), *judged]
    awaited = healed and accusation.fate is Fate.WAITS
    if awaited:
        service.timers[Trigger.LATE] = robot.time + service.substitute.patience
    if awaited or not healed:
        service.substitute.working_since = failure.good_until
    commands += service.step(
        state=State.HEALED if healed and not awaited else State.HEALING,
        killed=None,
        returned=None,
        detail=detail,
    )
    goes_on = healed and not repair.idle(service)
    return commands if goes_on else commands + repair.heal(service)


def show(service: ServiceMachine, _: Failure) -> List[Command]:
    """Show the incident as it is now."""
    return service.step(substitute=service.node)


def publish(service: ServiceMachine, _: Failure) -> List[Command]:
    """Note that the substitute publishes; what was silent can be killed now."""
    service.timers.clear()
    commands = service.step(state=State.HEALED, first_message=service.first_message())
    outage = service.incident.outage
    lasted = "" if outage is None else f" The outage lasted {outage:.3f} s."
    commands.append(service.log(f"{service.node} publishes it now.{lasted}", Level.INFO))
    if service.accusation.fate is Fate.WAITS:
        commands += service.judge(service.accusation, service.substitute.plan) + service.step()
    return commands


def hold_off(service: ServiceMachine, _: Failure) -> List[Command]:
    """Wait whether an original that is back stays healthy."""
    incident, row, robot = service.incident, service.returned(), service.robot
    assert row is not None
    service.nodes.returned(service.spec.name, incident.faulty_node, row.since, row.publisher)
    length = service.nodes.hold_off(incident.faulty_node)
    service.timers.clear()
    service.timers[Trigger.STEADY] = robot.time + length
    text = f"{incident.topic}: {row.publisher} is back."
    said = Log(Level.INFO, f"{text} It must stay healthy for {length:g} s.")
    another = row.publisher != incident.faulty_node
    judged = service.judge(service.accusation, replaced=True) if another else []
    return [said, *judged, *service.step(state=State.RETURNING, returned=row.since, detail=text)]


def end(service: ServiceMachine, _: Failure) -> List[Command]:
    """End the incident: the original is well again."""
    node, commands = service.node, service.substitute.rest(service.spec)
    stopped = " The substitute has stopped." if node != service.node else ""
    return commands + close(service, service.incident.detail + stopped) + repair.prepare(service)


def withdraw(service: ServiceMachine, _: Failure) -> List[Command]:
    """Heal the service no longer."""
    commands = service.substitute.drop()
    if service.state is State.WELL:
        return commands
    return commands + close(service, f"{service.spec.name} is not in the SOM any more.")


def close(service: ServiceMachine, why: str) -> List[Command]:
    """Close the incident."""
    node, time = service.incident.faulty_node, service.robot.time
    commands = service.step(state=State.ENDED, ended=time, detail=why)
    service.incident, service.accusation = WELL, Accusation()
    service.last_message = b""
    service.timers.clear()
    service.pauses = 0
    service.nodes.acquit(service.spec, node, well_at=time)
    return [*commands, Log(Level.INFO, why)]


_STUCK_OR_HEALING = (State.HEALING, State.UNHEALED, State.SAFE, State.KEPT)


def _rows() -> Iterable[Tuple[State, Trigger, Action, Tuple[State, ...]]]:
    well, healing, healed = State.WELL, State.HEALING, State.HEALED
    returning, unhealed, safe, kept = State.RETURNING, State.UNHEALED, State.SAFE, State.KEPT

    yield well, Trigger.FAILED, begin, (*_STUCK_OR_HEALING, well)
    yield well, Trigger.SUBSTITUTE_FAILED, repair.pause_standby, (well,)
    yield well, Trigger.REPLAN, repair.prepare, (well,)
    yield well, Trigger.RETRY, repair.prepare, (well,)
    yield well, Trigger.NO_VALUE, repair.change_law, (well,)

    yield healing, Trigger.FIRST_MESSAGE, publish, (healed,)
    yield healing, Trigger.LATE, repair.replace_late, _STUCK_OR_HEALING
    for state in SUBSTITUTED:
        yield state, Trigger.SILENT, repair.await_again, (healing,)
        yield state, Trigger.NO_VALUE, repair.change_law, (state,)
    yield healed, Trigger.OUTGROWN, repair.give_way, (healed, *_STUCK_OR_HEALING)
    for state in (healing, healed, safe):
        yield state, Trigger.SUBSTITUTE_FAILED, repair.heal, _STUCK_OR_HEALING

    for state in (healing, healed, unhealed, safe, kept):
        more = (healed,) if state in (healed, safe) else ()
        yield state, Trigger.FAILED, still_failing, (*_STUCK_OR_HEALING, *more)
        yield state, Trigger.REPLAN, replan, (*_STUCK_OR_HEALING, *more, well)
        yield state, Trigger.RETURNED, hold_off, (returning,)
        if state in WAITING:
            yield state, Trigger.RETRY, repair.retry, (*_STUCK_OR_HEALING, *more)
    yield kept, Trigger.SUBSTITUTE_FAILED, show, (kept,)

    yield returning, Trigger.FAILED, failed_again, (healed, *_STUCK_OR_HEALING)
    yield returning, Trigger.SUBSTITUTE_FAILED, show, (returning,)
    yield returning, Trigger.STEADY, end, (well,)
    for state in (well, healing, healed, returning, unhealed, safe, kept):
        yield state, Trigger.WITHDRAWN, withdraw, (well,)


TRANSITIONS: Transitions = {
    (state, trigger): (act, frozenset(to)) for state, trigger, act, to in _rows()
}

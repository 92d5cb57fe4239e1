"""The states of a service as a table, and what is done when they change.

docs/reference/ros.md shows this table.
"""
from dataclasses import replace
from typing import Iterable, List, Optional, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing.events import Command, Log, RunCommand, ShowIncident
from shsa_core.healing.incident import SUBSTITUTED, WAITING, WELL, Incident, State, Trigger
from shsa_core.healing.node import Accusation
from shsa_core.healing.process import standby
from shsa_core.healing.records import Fate
from shsa_core.healing.service import Action, Failure, ServiceMachine, Transitions
from shsa_core.model.kinds import Kind, Policy, Standby
from shsa_core.model.log import Level
from shsa_core.planning.placement import HERE
from shsa_core.planning.settings import LONGEST_START_S

NOT_MISSED = ShsaError("nothing is missing")


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
    commands: List[Command] = [Log(Level.WARN, text), ShowIncident(service.incident)]
    commands += heal(service)
    if failure.kind is Kind.REQUESTED and service.accusation.kept:
        commands += close(service, service.incident.detail)  # it goes on as it was
    return commands


def still_failing(service: ServiceMachine, failure: Failure) -> List[Command]:
    """Judge a node that failed once more, or another one beside it."""
    assert failure is not None
    nodes, node = service.nodes, failure.publisher
    commands: List[Command] = [service.log(f"{node} failed again: {failure.detail}.")]
    former = service.incident.faulty_node
    accusation = nodes.accuse(service.spec, node, failure.kind)
    if node != former:
        commands += service.judge(accusation, search(service)[0])
        if not (accusation.kept and accusation.heard):  # it is killed, or silent
            nodes.acquit(service.spec, node)
            return commands
        commands += blame(service, node, failure.kind)
    return commands + heal(service)


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
    plan, none = search(service)
    detail = f"{node} failed again: {failure.detail}"
    commands += [service.log(f"{detail}."), *service.judge(accusation, plan)]
    if service.nodes.kept_out(node) and not accusation.kept:
        detail = f"{node} keeps failing. It is kept out until it is released."
        commands.append(service.log(detail, Level.ERROR))
    healed = service.substitute.computes
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
    if idle(service):
        return commands + keep(service, plan, none)
    return commands if healed else commands + heal(service)


def await_again(service: ServiceMachine, failure: Failure) -> List[Command]:
    """Wait for a message: what it has published since counts, though it may be heard late."""
    assert failure is not None
    service.timers[Trigger.LATE] = service.robot.time + service.substitute.patience
    service.substitute.working_since = failure.good_until
    return service.step(state=State.HEALING, first_message=None)


def replace_late(service: ServiceMachine, _: Failure) -> List[Command]:
    """Replace a process whose first message has not come.

    The next best plan is taken if the plan is to blame.
    """
    robot, spec, substitute = service.robot, service.spec, service.substitute
    unseen = robot.health.row((spec.topic, service.node)) is None
    spare = service.processes.pool.spare(substitute.host) if standby(spec) is Standby.WARM else None
    away = not robot.computers.reachable(robot.computers.name(spec.host))
    ready = spare is not None and spare.node in service.processes.pool.heard
    starting = unseen and robot.time < substitute.started + LONGEST_START_S and not ready
    if starting or not robot.health.watched(spec.topic, away):
        # It is not up yet: a new process would only make the machine busier. Or nobody can say.
        service.timers[Trigger.LATE] = robot.time + substitute.patience
        return []
    said = service.log(f"the substitute failed: no message within {substitute.patience:.1f} s.")
    return [*substitute.failed(substitute.plan_to_blame), said, *heal(service)]


def change_law(service: ServiceMachine, _: Failure) -> List[Command]:
    """Follow the next plan, if there is one, as the substitute says that its law does not hold.

    Before an incident, the better law is looked at again after a while.
    """
    spec, substitute, robot = service.spec, service.substitute, service.robot
    well = service.state is State.WELL
    faulty = spec.node if well else service.incident.faulty_node
    another = substitute.another(spec, faulty)
    text = "the substitute's law does not hold now"
    if another is None:
        return [service.log(f"{text}, and there is no other.")]
    said = service.log(f"{text}. The next best takes its place.")
    if not well:
        substitute.tried = substitute.vain
        return [said, *heal(service)]
    service.timers[Trigger.RETRY] = robot.time + robot.settings.retry_limit
    return [*substitute.use(spec, another), said]


def give_way(service: ServiceMachine, _: Failure) -> List[Command]:
    """Follow a plan that errs clearly less by now, as another derivation contradicts this one.

    Without one, who errs more than is tolerated is used no more: silence does less harm.
    """
    substitute = service.substitute
    another = substitute.better(service.spec, service.incident.faulty_node)
    if another is None:
        why = substitute.plan and service.robot.planner.errs_too_much(substitute.plan)
        said = service.log(f"the substitute is used no more: {why}.")
        return [said, *heal(service)] if why else []
    substitute.tried = substitute.vain
    text = "the substitute is contradicted: its error has grown. The next best takes its place."
    return [service.log(text), *follow(service, another)]


def retry(service: ServiceMachine, _: Failure) -> List[Command]:
    """Try again, also the plans that were tried in vain."""
    service.substitute.forget()
    return heal(service)


def heal(service: ServiceMachine, _: Failure = None) -> List[Command]:
    """Search, decide about the node, and set a process to work, unless it follows that plan."""
    plan, none = search(service)
    commands = service.judge(service.accusation, plan)
    if idle(service):
        return commands + keep(service, plan, none)
    if not service.spec.policy.substitutes:
        return commands + wait_for_node(service)
    if plan is None:
        return commands + give_up(service, none)
    follows = service.incident.state is State.HEALED or Trigger.LATE in service.timers
    if follows and plan == service.substitute.plan:
        return commands + service.step() if commands else []
    return commands + follow(service, plan)


def search(service: ServiceMachine) -> Tuple[Optional[Plan], ShsaError]:
    """Return the plan to follow now; None: there is none, and why."""
    spec, policy, substitute = service.spec, service.spec.policy, service.substitute
    service.place = HERE
    try:
        if not policy.plans:
            raise ShsaError(f"its policy is {policy}")
        plan = substitute.find(spec, service.incident.faulty_node)
        if policy.substitutes:
            service.place = substitute.place(spec, plan)
        return plan, NOT_MISSED
    except ShsaError as none:
        return None, none


def idle(service: ServiceMachine) -> bool:
    """Tell that nothing is done: by its policy, or as a kept node is heard, or not replaced."""
    policy, accused = service.spec.policy, service.accusation
    return policy is Policy.ADVISE or (accused.kept and (accused.heard or not policy.substitutes))


def follow(service: ServiceMachine, plan: Plan) -> List[Command]:
    """Set a process to work on a plan."""
    spec, robot, substitute = service.spec, service.robot, service.substitute
    incident = service.incident
    state, first_message, last_good = incident.state, incident.first_message, incident.last_good
    if state is State.KEPT:
        substitute.working_since = robot.time
    publishes = bool(substitute.node) and state in (State.HEALED, State.SAFE)
    text, place = f"{spec.topic}: found a substitute of {plan.told}.", service.place
    commands = substitute.use(spec, plan, place, publishes)
    starts = bool(commands)
    if spec.standby is Standby.WARM and starts:
        text += " No idle process is left: this is a cold start."
    text += place.words
    commands.append(Log(Level.INFO, text))
    service.timers.clear()
    state = State.HEALED
    if not publishes:
        service.timers[Trigger.LATE] = robot.time + substitute.patience
        state, first_message, last_good = State.HEALING, None, ends_at(service)
    return commands + service.step(
        state=state,
        first_message=first_message,
        last_good=last_good,
        found=robot.time,
        spawned=None if starts else robot.time,
        detail=text,
        substitute=substitute.node,
        missing=plan.missing,
        **service.shown(plan),
    )


def ends_at(service: ServiceMachine) -> Optional[float]:
    """Return when the last good message came: now, if the substitute published until now."""
    incident, first = service.incident, service.incident.first_message
    last = incident.last_good
    publishes = first is not None and (last is None or last < first)
    return service.robot.time if publishes and incident.state is State.HEALED else last


def wait(service: ServiceMachine, acts: bool = True) -> List[Command]:
    """Set the time of the next try, and run the last resort, if it `acts`, before the first."""
    waits, spec = service.state in WAITING, service.spec
    due = service.timers.get(Trigger.RETRY) if waits else None
    service.timers.clear()
    service.timers[Trigger.RETRY] = service.robot.time + pause(service) if due is None else due
    words = spec.last_resort.command
    return [RunCommand(spec.name, words)] if words and acts and not waits else []


def keep(service: ServiceMachine, plan: Optional[Plan], none: ShsaError) -> List[Command]:
    """Say what could be done: the node is kept, and nobody publishes beside it."""
    spec, incident = service.spec, service.incident
    commands = service.substitute.rest(spec)
    acts = spec.policy is not Policy.ADVISE and incident.kind is not Kind.REQUESTED
    commands += wait(service, acts)
    could = f"It cannot be replaced: {none}"
    if plan is not None:
        could = f"It could be replaced: {plan.told}"
    detail = f"{spec.topic}: {service.accusation.decision}. {could}."
    if incident.state is State.KEPT and incident.detail == detail:
        return commands
    commands += [Log(Level.WARN, detail)] if spec.policy is Policy.ADVISE else []
    return commands + service.step(
        state=State.KEPT,
        killed=None if service.accusation.kept else incident.killed,
        detail=detail,
        missing=none.missing,
        substitute="",
        **service.shown(plan),
    )


def give_up(service: ServiceMachine, none: ShsaError) -> List[Command]:
    """Say what is missing, and try again later: nothing can substitute."""
    spec, incident = service.spec, service.incident
    commands = service.substitute.use_safe_values(spec)
    commands += wait(service)
    plan = service.substitute.plan
    service.nodes.forgive(incident.faulty_node)  # one that keeps failing is better than none
    state = State.SAFE if plan or spec.last_resort.command else State.UNHEALED
    before = (incident.state, incident.missing, incident.substitute, incident.decision)
    if before == (state, none.missing, service.node, service.accusation.decision):
        return commands
    text = f"{spec.topic} cannot be healed now: {none}."
    if plan:
        text += " Its safe values are published."
    commands.append(Log(Level.ERROR, text))
    return commands + service.step(
        state=state,
        first_message=None,
        last_good=ends_at(service),
        detail=text,
        missing=none.missing,
        substitute=service.node,
        **service.shown(plan),
    )


def wait_for_node(service: ServiceMachine) -> List[Command]:
    """Wait for the node's start, which is all that can heal the service; give up in the end."""
    incident, robot = service.incident, service.robot
    service.timers.pop(Trigger.LATE, None)
    node, killed = incident.faulty_node, incident.killed is not None
    if killed and not service.nodes.awaited(node):
        service.start_node()  # the policy may have been another one when it was killed
    trust, stranger = service.nodes.trust_in(node), node != service.spec.node
    if trust.exhausted or (killed and stranger):  # how a stranger was started is not known
        text = f"{node} was started again {trust.restarts} times in vain"
        return give_up(service, ShsaError(text))
    if incident.substitute and not service.node:
        return service.step(state=State.HEALING, substitute="")
    if service.state in WAITING:
        service.timers.setdefault(Trigger.RETRY, robot.time + pause(service))
    return []


def prepare(service: ServiceMachine, _: Failure = None) -> List[Command]:
    """Keep the substitute of a hot service on the best plan; without an incident."""
    return service.substitute.prepare(service.spec)


def pause_standby(service: ServiceMachine, _: Failure) -> List[Command]:
    """Prepare again after a pause."""
    service.timers[Trigger.RETRY] = service.robot.time + pause(service)
    return []


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
    service.nodes.returned(service.spec.name, incident.faulty_node, row.since)
    length = service.nodes.hold_off(incident.faulty_node)
    service.timers.clear()
    service.timers[Trigger.STEADY] = robot.time + length
    text = f"{incident.topic}: {row.publisher} is back."
    said = Log(Level.INFO, f"{text} It must stay healthy for {length:g} s.")
    return [said, *service.step(state=State.RETURNING, returned=row.since, detail=text)]


def end(service: ServiceMachine, _: Failure) -> List[Command]:
    """End the incident: the original is well again."""
    node, commands = service.node, service.substitute.rest(service.spec)
    stopped = " The substitute has stopped." if node != service.node else ""
    return commands + close(service, service.incident.detail + stopped) + prepare(service)


def withdraw(service: ServiceMachine, _: Failure) -> List[Command]:
    """Heal the service no longer."""
    commands = service.substitute.drop()
    service.timers.clear()
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


def pause(service: ServiceMachine) -> float:
    """Return how long to wait before the next try, in s."""
    service.pauses += 1
    return service.robot.settings.paused(service.pauses - 1)


_STUCK_OR_HEALING = (State.HEALING, State.UNHEALED, State.SAFE, State.KEPT)


def _rows() -> Iterable[Tuple[State, Trigger, Action, Tuple[State, ...]]]:
    """Yield a state, a trigger, what is done, and the states that it may lead to."""
    well, healing, healed = State.WELL, State.HEALING, State.HEALED
    returning, unhealed, safe, kept = State.RETURNING, State.UNHEALED, State.SAFE, State.KEPT

    yield well, Trigger.FAILED, begin, (*_STUCK_OR_HEALING, well)
    yield well, Trigger.SUBSTITUTE_FAILED, pause_standby, (well,)
    yield well, Trigger.REPLAN, prepare, (well,)
    yield well, Trigger.RETRY, prepare, (well,)
    yield well, Trigger.NO_VALUE, change_law, (well,)

    yield healing, Trigger.FIRST_MESSAGE, publish, (healed,)
    yield healing, Trigger.LATE, replace_late, _STUCK_OR_HEALING
    for state in SUBSTITUTED:
        yield state, Trigger.SILENT, await_again, (healing,)
        yield state, Trigger.NO_VALUE, change_law, (state,)
    yield healed, Trigger.OUTGROWN, give_way, (healed, *_STUCK_OR_HEALING)
    for state in (healing, healed, safe):
        yield state, Trigger.SUBSTITUTE_FAILED, heal, _STUCK_OR_HEALING

    for state in (healing, healed, unhealed, safe, kept):
        more = (healed,) if state in (healed, safe) else ()
        yield state, Trigger.FAILED, still_failing, (*_STUCK_OR_HEALING, *more)
        yield state, Trigger.REPLAN, heal, (*_STUCK_OR_HEALING, *more)
        if state in WAITING:
            yield state, Trigger.RETRY, retry, (*_STUCK_OR_HEALING, *more)
    yield kept, Trigger.SUBSTITUTE_FAILED, show, (kept,)
    for state in (healing, healed, unhealed, safe, kept):
        yield state, Trigger.RETURNED, hold_off, (returning,)

    yield returning, Trigger.FAILED, failed_again, (healed, *_STUCK_OR_HEALING)
    yield returning, Trigger.SUBSTITUTE_FAILED, show, (returning,)
    yield returning, Trigger.STEADY, end, (well,)
    for state in (well, healing, healed, returning, unhealed, safe, kept):
        yield state, Trigger.WITHDRAWN, withdraw, (well,)


TRANSITIONS: Transitions = {
    (state, trigger): (act, frozenset(to)) for state, trigger, act, to in _rows()
}

"""Has a service published again: searches, has its node judged, and sets a process to work."""
from typing import Dict, List, Optional, Tuple

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing.events import Command, Log, RunCommand
from shsa_core.healing.incident import WAITING, State, Trigger
from shsa_core.healing.process import standby
from shsa_core.healing.service import Failure, ServiceMachine
from shsa_core.model.kinds import Kind, Policy, Standby
from shsa_core.model.log import Level
from shsa_core.planning.placement import HERE, Place
from shsa_core.planning.settings import LONGEST_START_S

NOT_MISSED = ShsaError("nothing is missing")


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
    return [service.log(text), *follow(service, another, Place(substitute.host))]


def retry(service: ServiceMachine, _: Failure) -> List[Command]:
    """Try again, also the plans that were tried in vain."""
    service.substitute.forget()
    return heal(service)


def heal(service: ServiceMachine, _: Failure = None) -> List[Command]:
    """Search, decide about the node, and set a process to work, unless it follows that plan."""
    plan, place, none = search(service)
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
    return commands + follow(service, plan, place)


def search(service: ServiceMachine) -> Tuple[Optional[Plan], Place, ShsaError]:
    """Return the plan to follow now, and where; None: there is none, and why."""
    spec, policy, substitute = service.spec, service.spec.policy, service.substitute
    try:
        if not policy.plans:
            raise ShsaError(f"its policy is {policy}")
        plan = substitute.find(spec, service.incident.faulty_node)
        place = substitute.place(spec, plan) if policy.substitutes else HERE
        return plan, place, NOT_MISSED
    except ShsaError as none:
        return None, HERE, none


def idle(service: ServiceMachine) -> bool:
    """Tell that nothing is done: by its policy, or as a kept node is heard, or not replaced."""
    policy, accused = service.spec.policy, service.accusation
    return policy is Policy.ADVISE or (accused.kept and (accused.heard or not policy.substitutes))


def follow(service: ServiceMachine, plan: Plan, place: Place) -> List[Command]:
    """Set a process to work on a plan, in a place."""
    spec, robot, substitute = service.spec, service.robot, service.substitute
    state = service.incident.state
    if state is State.KEPT:
        substitute.working_since = robot.time
    publishes = bool(substitute.node) and state in (State.HEALED, State.SAFE)
    text = f"{spec.topic}: found a substitute of {plan.told}."
    commands = substitute.use(spec, plan, place, publishes)
    starts = bool(commands)
    if spec.standby is Standby.WARM and starts:
        text += " No idle process is left: this is a cold start."
    text += place.words
    commands.append(Log(Level.INFO, text))
    service.timers.clear()
    anew: Dict[str, object] = {}
    if not publishes:
        service.timers[Trigger.LATE] = robot.time + substitute.patience
        anew = {"first_message": None, "last_good": ends_at(service)}
    return commands + service.step(
        state=State.HEALED if publishes else State.HEALING,
        **anew,
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
    could = f"It could be replaced: {plan.told}" if plan else f"It cannot be replaced: {none}"
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
    service.start_node(anew=True)
    trust, kills = service.nodes.trust_in(node), service.nodes.kills
    awaited = service.nodes.awaited(node) or kills.under_way(node)
    if trust.exhausted or (killed and not awaited):  # how a stranger was started is not known
        text = f"{node} was started again {trust.restarts} times in vain"
        return give_up(service, ShsaError(text))
    waits = service.state in WAITING
    if waits:
        service.timers.setdefault(Trigger.RETRY, robot.time + pause(service))
    if incident.substitute and not service.node:  # its safe values have ended
        state = State.UNHEALED if waits else State.HEALING
        return service.step(state=state, substitute="")
    return []


def prepare(service: ServiceMachine, _: Failure = None) -> List[Command]:
    """Keep the substitute of a hot service on the best plan; without an incident."""
    return service.substitute.prepare(service.spec)


def pause_standby(service: ServiceMachine, _: Failure) -> List[Command]:
    """Prepare again after a pause."""
    service.timers[Trigger.RETRY] = service.robot.time + pause(service)
    return []


def pause(service: ServiceMachine) -> float:
    """Return how long to wait before the next try, in s."""
    service.pauses += 1
    return service.robot.settings.paused(service.pauses - 1)

"""Decides on changed numbers of the SOM: what a healthy publisher would violate at once is refused.

That is a mistake of whoever wrote them, and no fault of the node. There is no waiting period: its
last good values, its rate and its pauses so far are judged by the new numbers.
"""
from dataclasses import replace
from typing import List, Optional, Tuple, Union

from shsa_core.model.kinds import Kind
from shsa_core.model.service import Deadlines, Service, is_within
from shsa_core.model.som import Som
from shsa_core.monitoring.board import Board
from shsa_core.monitoring.events import ChangeRefused, Told
from shsa_core.monitoring.evidence import Finding
from shsa_core.monitoring.publishers import Publisher

Change = Union[Told, ChangeRefused]


def decide(board: Board, som: Som, deadlines: Deadlines, time: float) -> Tuple[Som, List[Change]]:
    """Return `som` with the numbers that count, and what becomes of those that have changed."""
    services = dict(som.services)
    changes: List[Change] = []
    for service in som:
        topic = board.topics.get(service.topic)
        watched = topic.services.get(service.name) if topic else None
        if topic is None or watched is None or watched.service.node != service.node:
            continue
        kept = _with_numbers_of(watched.service, service)
        if kept == service:
            continue
        allowed = watched.would_allow(service, deadlines)
        concerned = [each for each in topic.healthy() if each.watched is watched]
        found = [(each.name, _violation(each, service, allowed, time)) for each in concerned]
        text = f"{service.where or service.name}: {_told(service, kept)}"
        wrong = next(((name, why) for name, why in found if why), None)
        if wrong is None:
            whom = ", ".join(each.name for each in concerned) or "nobody yet"
            weaker = allowed > watched.allowed or _weakens(kept, service)
            more = "; it allows more" if weaker else ""
            changes.append(Told(time, f"Changed: {text}; it concerns {whom}{more}", weaker))
        else:
            services[service.name] = kept
            name, why = wrong
            text = f"{text}: {name} is healthy, and would fail at once: {why.kind}: {why.detail}"
            changes.append(ChangeRefused(time, kept, text))
    return som.with_services(services.values()), changes


def _violation(
    publisher: Publisher, service: Service, allowed: float, time: float
) -> Optional[Finding]:
    """Return what a healthy publisher would do wrong by changed numbers, `allowed` s of silence."""
    if publisher.evidence is None:
        return None
    last = publisher.since if publisher.last_heard is None else publisher.last_heard
    pause = max(publisher.evidence.pause, time - last)
    if pause > allowed:
        told = f"no message for {pause:.3f} s, {allowed:.3g} s would be allowed"
        return Finding(Kind.SILENT, told)
    return publisher.evidence.violation(service)


def _with_numbers_of(old: Service, new: Service) -> Service:
    """Return `new` with the numbers by which publishers of `old` are judged."""
    before = {each.property: each for each in old.provides}
    provides = tuple(
        replace(each, range=before[each.property].range, checks=before[each.property].checks)
        if each.property in before
        else each
        for each in new.provides
    )
    numbers = dict(period=old.period, deadline=old.deadline, checks=old.checks)
    return replace(new, provides=provides, **numbers)


def _weakens(old: Service, new: Service) -> bool:
    """Tell if a publisher may do what it might not before."""
    pairs = list(zip(new.provides, old.provides))
    return (
        (new.period or 0.0) > (old.period or 0.0)
        or (new.checks.bad, new.checks.of) != (old.checks.bad, old.checks.of)
        or not set(old.checks.each) <= set(new.checks.each)
        or any(not set(before.checks) <= set(now.checks) for now, before in pairs)
        or any(not is_within(now.range, before.range) for now, before in pairs)
    )


def _told(new: Service, old: Service) -> str:
    """Return the numbers that differ, in words."""
    numbers: List[Tuple[str, object, object]]
    numbers = [("period", new.period, old.period), ("deadline", new.deadline, old.deadline)]
    checks: List[Tuple[str, object, object]] = [("checks", new.checks, old.checks)]
    for now, before in zip(new.provides, old.provides):
        numbers.append((f"range of {now.property}", now.range, before.range))
        checks.append((f"checks of {now.property}", now.checks, before.checks))
    said = [f"{what}: {n or 'usual'} (so far {b or 'usual'})" for what, n, b in numbers if n != b]
    return ", ".join(said + [what for what, n, b in checks if n != b])

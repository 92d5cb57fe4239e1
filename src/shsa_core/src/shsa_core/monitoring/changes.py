"""Decides on changed numbers of the SOM: what a healthy publisher would violate at once is refused.

That is a mistake of whoever wrote them, and no fault of the node. There is no waiting period: its
last good values, its rate and its pauses so far are judged by the new numbers.
"""
from dataclasses import replace
from typing import Optional

from shsa_core.model.checks import Finding
from shsa_core.model.kinds import Kind
from shsa_core.model.log import Level, Log
from shsa_core.model.som import Som, differences
from shsa_core.model.service import Deadlines, Service
from shsa_core.monitoring.board import Board
from shsa_core.monitoring.events import ChangeRefused
from shsa_core.monitoring.publishers import Publisher


def decide(board: Board, som: Som, deadlines: Deadlines) -> Som:
    """Return `som` with the numbers that count; say what becomes of those that have changed."""
    services = dict(som.services)
    for service in som:
        topic = board.topics.get(service.topic)
        watched = topic.services.get(service.name) if topic else None
        if topic is None or watched is None or watched.service.node != service.node:
            continue
        kept = _with_numbers_of(watched.service, service)
        what = differences(service, kept, "so far")
        if not what:
            continue
        changed = replace(watched)
        changed.judge_by(service, deadlines)
        allowed = changed.allowed
        concerned = [each for each in topic.healthy() if each.watched is watched]
        found = [(each.name, _violation(each, service, allowed, board.now)) for each in concerned]
        text = f"{service.where or service.name}: {what}"
        wrong = next(((name, why) for name, why in found if why), None)
        if wrong is None:
            whom = ", ".join(each.name for each in concerned) or "nobody yet"
            text = f"Changed: {text}; it concerns {whom}"
            more = f"{text}; it allows more than the SOM file: {service.weakened}"
            board.say([Log(Level.WARN, more) if service.weakened else Log(Level.INFO, text)])
        else:
            services[service.name] = kept
            name, why = wrong
            text = f"{text}: {name} is healthy, and would fail at once: {why.kind}: {why.detail}"
            board.say([ChangeRefused(kept, text)])
    return som.with_services(services.values())


def _violation(
    publisher: Publisher, service: Service, allowed: float, time: float
) -> Optional[Finding]:
    """Return what a healthy publisher would do wrong by changed numbers, `allowed` s of silence."""
    last = publisher.since if publisher.last_heard is None else publisher.last_heard
    pause = max(publisher.evidence.rate.pause, time - last)
    if pause > allowed:
        told = f"no message for {pause:.3f} s, {allowed:.3g} s would be allowed"
        return Finding(Kind.SILENT, told)
    return publisher.evidence.violation(service)


def _with_numbers_of(old: Service, new: Service) -> Service:
    """Return `new` with the numbers by which publishers of `old` are judged."""
    kept = {each.property: each for each in (*new.provides, *old.provides)}
    pairs = [(each, kept[each.property]) for each in new.provides]
    provides = tuple(replace(each, range=was.range, checks=was.checks) for each, was in pairs)
    numbers = ("period", "deadline", "checks", "weakened", "fastest")
    return replace(new, provides=provides, **{name: getattr(old, name) for name in numbers})

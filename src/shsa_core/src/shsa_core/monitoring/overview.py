"""Sums up for people how each service is doing, by all who publish for it."""
from dataclasses import dataclass
from typing import Dict, List, Tuple

from shsa_core.model.health import PublisherHealth
from shsa_core.model.kinds import Word
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.board import FAILED, UNKNOWN, Board
from shsa_core.monitoring.publishers import NOBODY, Publisher


class Condition(Word):
    """The condition of a service."""

    HEALTHY = "healthy"
    DOUBTFUL = "doubtful"  # healthy, but contradicted, unusual, or beside one that fails
    SUBSTITUTED = "substituted"
    STARTING = "starting"
    LOST = "lost"


@dataclass(frozen=True)
class ServiceHealth:
    """One service, its condition in words, and the publishers that it comes from.

    `publishers`: with the number of messages of each so far. `values`: what a healthy one told
    last, by property.
    """

    service: Service
    condition: Condition
    detail: str
    publishers: Dict[PublisherHealth, int]
    values: Dict[str, float]
    deadline: str = ""  # the silence that its node is allowed; empty: it is not learned
    bridged: int = 0  # so often has a muted substitute filled in for it


def overview(som: Som, board: Board) -> Tuple[ServiceHealth, ...]:
    """Return every service of a SOM; the substitutes that stand by are left out."""
    suspicions = (s for p in board.all() if p.is_healthy for s in p.suspicions.values())
    doubts = {name: text for each in suspicions for name, text in each.doubts.items()}
    return tuple(_health(service, board, doubts.get(service.name, "")) for service in som)


def _health(service: Service, board: Board, doubt: str) -> ServiceHealth:
    topic = board.topics[service.topic]
    concerned = [p for p in topic.publishers.values() if _concerns(board, p, service)]
    own = (p.detail for p in concerned if p.name == service.node and p.was_logged)
    condition, detail = _condition(board, concerned)
    doubt = doubt or next(own, "")
    if condition is Condition.HEALTHY and doubt:
        condition, detail = Condition.DOUBTFUL, doubt
    shown = [each for each in concerned if each.name != NOBODY]
    rows = {each.row(board.ours): each.messages for each in shown}
    healthy = [each for each in shown if each.is_healthy][:1]
    told = (pair for p in healthy for pair in zip(p.evidence.properties, p.values or ()))
    values = {name: value for name, value in told if value is not None}
    watched = topic.services[service.name]
    gaps = watched.gaps
    deadline = "" if gaps is None else f"{gaps.allowed:.3f} s, {gaps.told()}"
    return ServiceHealth(service, condition, detail, rows, values, deadline, watched.bridged)


def _concerns(board: Board, publisher: Publisher, service: Service) -> bool:
    """Tell if it publishes for a service, or on its topic without anybody knowing what for."""
    name = publisher.service.name
    if publisher.state is UNKNOWN and board.may_be_silent(publisher):
        return False  # it stands by
    return name == service.name or (not name and publisher.name != NOBODY)


def _condition(board: Board, publishers: List[Publisher]) -> Tuple[Condition, str]:
    failed = [each for each in publishers if each.state is FAILED]
    told = "; ".join(f"{each.name or 'nobody publishes'}: {each.detail}" for each in failed)
    healthy = [each for each in publishers if each.is_healthy and each.service.name]
    rows = {each.name: board.substitution(each) for each in healthy}
    own = [name for name, row in rows.items() if row is None or not row.service]
    if own and any(each.connected for each in failed):
        return Condition.DOUBTFUL, told
    if own:
        return Condition.HEALTHY, "healthy"
    if healthy:
        return Condition.SUBSTITUTED, "; ".join(filter(None, (f"by {healthy[0].name}", told)))
    if failed:
        return Condition.LOST, told
    why = (each.detail for each in publishers if each.detail)
    return Condition.STARTING, next(why, "waits for its first message")

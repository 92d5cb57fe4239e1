"""How long it may take until somebody publishes a service: at the start, and after a new one.

A robot that is not there at all is awaited, and nobody is blamed. Who did well under a former
monitor is there already. Nobody is missed on a topic that is not subscribed yet: with hundreds of
them, on a busy computer, that takes longer than a node has to come up.
"""
from typing import List, Tuple

from shsa_core.monitoring.board import Board, Grace
from shsa_core.monitoring.events import FormerlyHealthy, Key, RobotAwaited
from shsa_core.monitoring.publishers import WatchedService, WatchedTopic
from shsa_core.monitoring.silence import TOGETHER_NODES

CONNECT_S = 0.4
"""A new monitor takes so long at most to connect to who is there."""
SUBSCRIBE_S = 0.01
"""For each topic: those that are subscribed one after the other have connections made meanwhile."""
TOGETHER_S = 5.0
"""So long several nodes that are not heard together count as not connected yet."""
AGAIN_S = 0.5


class Arrivals:
    """Says when a service for which no message came is missed. Times in s."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._robot_came = False
        self._told = False
        self._awaited: Tuple[Key, ...] = ()

    def came(self, time: float, grace: float) -> None:
        """Somebody is there who is no substitute: the others have their time from now on."""
        if self._robot_came:
            return
        self._robot_came = True
        for topic in self._board.topics.values():
            for watched in topic.services.values():
                watched.due = max(watched.due, time + grace)

    def expect(self, event: FormerlyHealthy) -> None:
        """These did well under a former monitor: they are missed soon."""
        self._robot_came = self._robot_came or bool(event.publishers)
        for name, publisher in event.publishers:
            topic = self._board.topics.get(name)
            watched = self._board.watched_of(topic, publisher) if topic else None
            if topic is None or watched is None or watched.published or watched.overdue:
                continue
            watched.formerly = publisher, event.time
            if topic.subscribed:
                self._miss(topic, watched, min(watched.due, self._soon(watched, event.time)))

    def subscribed(self, topic: WatchedTopic, time: float, grace: float) -> None:
        """Who publishes a topic has its time from now on."""
        topic.subscribed = True
        for watched in topic.services.values():
            publisher, _ = watched.formerly
            if publisher:
                watched.formerly = publisher, time
            self._miss(topic, watched, self._soon(watched, time) if publisher else time + grace)

    def _miss(self, topic: WatchedTopic, watched: WatchedService, due: float) -> None:
        watched.due = due
        self._board.agenda.bring_forward(Grace(topic.name, watched.service.name), due)

    def _soon(self, watched: WatchedService, time: float) -> float:
        """When a message of a node that is there already is missed, if none came since `time`."""
        wait = 0.0 if watched.service.event_driven else watched.deadline
        return time + wait + CONNECT_S + SUBSCRIBE_S * len(self._board.topics)

    def due(self, watched: WatchedService, time: float, grace: float) -> float:
        """When a service that is due is missed: now, or later."""
        if watched.formerly[0]:
            together = len(self._unheard()) >= TOGETHER_NODES
            last = watched.formerly[1] + TOGETHER_S
            return min(time + AGAIN_S, last) if together and time < last else time
        if self._robot_came:
            return time
        if not self._told:
            self._told = True
            self._awaited = tuple(
                (topic.name, each.service.node)
                for topic in self._board.topics.values()
                for each in topic.services.values()
            )
        return time + grace

    def awaited(self, time: float) -> List[RobotAwaited]:
        """What is to be told: once, for whom is waited."""
        awaited, self._awaited = self._awaited, ()
        return [RobotAwaited(time, awaited)] if awaited else []

    def _unheard(self) -> List[str]:
        """The nodes that did well under a former monitor, and were not heard yet."""
        services = [
            each for topic in self._board.topics.values() for each in topic.services.values()
        ]
        missed = (each.formerly[0] for each in services if not each.published)
        return sorted({node for node in missed if node})

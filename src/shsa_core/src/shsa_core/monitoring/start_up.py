"""Blames who has never been there: at the start, and after another monitor."""
from dataclasses import replace
from math import inf
from typing import Iterator

from shsa_core.model.kinds import Kind
from shsa_core.monitoring.alibis import Case, decide
from shsa_core.monitoring.board import FAILED, Board
from shsa_core.monitoring.events import FormerlyHealthy, Subscribed
from shsa_core.monitoring.publishers import NOBODY, WatchedService, WatchedTopic
from shsa_core.monitoring.settings import RECONNECT_S
from shsa_core.monitoring.surroundings import Surroundings


class StartUp:
    """Waits `grace` s for the first message of a service, less if its node did well. Times in s."""

    def __init__(self, board: Board, grace: float, around: Surroundings) -> None:
        self._board, self._grace, self._around = board, grace, around
        self._robot_came = self._told = False

    def came(self) -> None:
        """Note that somebody is there who is no substitute: the others have their time from now."""
        if not self._robot_came:
            self._robot_came = True
            for watched in self._services():
                watched.due = max(watched.due, self._board.now + self._grace)

    def expect(self, event: FormerlyHealthy) -> None:
        """Miss those soon that did well under a former monitor, whoever was heard instead."""
        self._robot_came = self._robot_came or bool(event.publishers)
        topics = self._board.topics
        for topic, publisher in ((topics[n], p) for n, p in event.publishers if n in topics):
            watched = self._board.watched_of(topic, publisher)
            if watched.due < inf or (watched.came and publisher not in topic.publishers):
                watched.formerly = publisher, event.time
                if topic.subscribed:
                    self._await(watched, min(watched.due, self._due(watched)))

    def subscribed(self, event: Subscribed) -> None:
        """Give who publishes a topic its time from now on."""
        topic = self._board.topics.get(event.topic)
        if topic is None or topic.subscribed:
            return
        topic.subscribed, topic.heard_from = True, self._board.now
        for watched in topic.services.values():
            watched.formerly = watched.formerly[0], self._board.now
            self._await(watched, self._due(watched))

    def left(self, topic: WatchedTopic) -> None:
        """Await somebody as at the start: nobody is left on a topic, and nobody is blamed.

        So it is where substitutes end whose original died before this monitor started.
        """
        for watched in topic.services.values():
            if watched.came:
                watched.came = False
                self._await(watched, self._board.now + self._grace)

    def judge(self, watched: WatchedService) -> None:
        """Blame somebody if a service has never been there, once its time is over."""
        topic = self._board.topics.get(watched.service.topic)
        if topic is None or topic.services.get(watched.service.name) is not watched:
            return
        if topic.subscribed and self._board.now >= watched.due:
            self._miss(topic, watched)
        if topic.subscribed:
            self._await(watched, watched.due)

    def _await(self, watched: WatchedService, due: float) -> None:
        """Miss a service if nobody was there for it by `due`."""
        watched.due = due
        self._board.agenda.bring_forward(watched, due)

    def _due(self, watched: WatchedService) -> float:
        """Return when a message is missed: soon, if its node is there already."""
        formerly, told = watched.formerly
        if not formerly:
            return self._board.now + self._grace
        return told + RECONNECT_S + (0.0 if watched.service.event_driven else watched.deadline)

    def _miss(self, topic: WatchedTopic, watched: WatchedService) -> None:
        (formerly, told), now = watched.formerly, self._board.now
        there = formerly in topic.publishers and topic.publishers[formerly].connected
        case = Case(Kind.NEVER_PUBLISHED, now, told, robot_came=self._robot_came or bool(formerly))
        if formerly:
            short, together = self._around.short(formerly) if there else -inf, self._unheard()
            case = replace(case, limit=told + self._grace, short=short, together=together)
        alibi = decide(case)
        if alibi is None:
            self._blame(topic, watched)
            return
        if not (case.robot_came or self._told):
            self._told = True
            services = (each.service for each in self._services())
            named = ", ".join(f"{each.topic} from {each.node}" for each in services)
            self._board.warn(f"No node of the SOM is there yet. Waiting for: {named}")
        watched.due = min(alibi.until, now + (RECONNECT_S if formerly else self._grace))

    def _blame(self, topic: WatchedTopic, watched: WatchedService) -> None:
        board, (formerly, told), now = self._board, watched.formerly, self._board.now
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and nobody.state is FAILED and nobody.since == now:
            watched.due = now + RECONNECT_S  # one row at a time says for which service
            return
        watched.due = inf
        connected = [p for p in topic.publishers.values() if p.watched is watched]
        silent = [p for p in connected if p.connected and not p.is_healthy]
        guilty = [p for p in silent if not board.may_be_silent(p)]
        blamed = min(guilty, key=lambda p: p.name != watched.service.node, default=None)
        if blamed is None:
            blamed = board.expect(topic, formerly or NOBODY)
            blamed.provide(watched)
        what = "publisher" if watched.service.event_driven else "message"
        detail = f"no {what} in the first {self._grace:g} s"
        if formerly:
            detail = f"no {what} for {now - told:.3f} s, since this monitor listens"
        board.fail(blamed, Kind.NEVER_PUBLISHED, detail)

    def _unheard(self) -> int:
        """Count the nodes that did well under a former monitor, and were not heard yet."""
        return len({each.formerly[0] for each in self._services() if not each.came} - {""})

    def _services(self) -> Iterator[WatchedService]:
        for topic in self._board.topics.values():
            yield from topic.services.values()

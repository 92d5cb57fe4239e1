"""Blames who has never been there: at the start, and after another monitor."""
from math import inf
from typing import List, Optional

from shsa_core.model.kinds import Kind
from shsa_core.monitoring.alibis import NOBODY_CAME, Blame, Case, decide
from shsa_core.monitoring.board import FAILED, Board, Grace
from shsa_core.monitoring.events import FormerlyHealthy, Told
from shsa_core.monitoring.publishers import NOBODY, WatchedService, WatchedTopic
from shsa_core.monitoring.settings import RECONNECT_S, SUBSCRIBE_S
from shsa_core.monitoring.surroundings import Surroundings


class StartUp:
    """Waits for the first message of each service, `grace` s at most. Times in s.

    A robot that is not there at all is awaited, and nobody is blamed. Who did well under a former
    monitor is there already, and is missed soon.
    """

    def __init__(self, board: Board, grace: float, around: Surroundings) -> None:
        self._board, self._grace, self._around = board, grace, around
        self._robot_came = False
        self._awaited: Optional[str] = None

    def came(self, time: float) -> None:
        """Note that somebody is there who is no substitute: the others have their time from now."""
        if not self._robot_came:
            self._robot_came = True
            for topic in self._board.topics.values():
                for watched in topic.services.values():
                    watched.due = max(watched.due, time + self._grace)

    def expect(self, event: FormerlyHealthy) -> None:
        """Miss those soon that did well under a former monitor."""
        self._robot_came = self._robot_came or bool(event.publishers)
        for name, publisher in event.publishers:
            topic = self._board.topics.get(name)
            watched = self._board.watched_of(topic, publisher) if topic else None
            if topic is None or watched is None or watched.published or watched.overdue:
                continue
            watched.formerly = publisher, event.time
            if topic.subscribed:
                self.await_(topic, watched, min(watched.due, self._soon(watched)))

    def subscribed(self, topic: WatchedTopic, time: float) -> None:
        """Give who publishes a topic its time from now on."""
        topic.subscribed = True
        for watched in topic.services.values():
            publisher, _ = watched.formerly
            if publisher:
                watched.formerly = publisher, time
            self.await_(topic, watched, self._soon(watched) if publisher else time + self._grace)

    def left(self, topic: WatchedTopic, time: float) -> None:
        """Await somebody as at the start: nobody is left on a topic, and nobody is blamed.

        So it is where substitutes end whose original died before this monitor started.
        """
        for watched in topic.services.values():
            if watched.published or watched.appeared:
                watched.published = watched.appeared = watched.overdue = False
                self.await_(topic, watched, time + self._grace)

    def await_(self, topic: WatchedTopic, watched: WatchedService, due: float) -> None:
        """Miss a service if nobody was there for it by `due`."""
        watched.due = due
        self._board.agenda.bring_forward(Grace(topic.name, watched.service.name), due)

    def judge(self, due: Grace, time: float) -> None:
        """Blame somebody if a service has never been there, once its time is over."""
        topic = self._board.topics.get(due.topic)
        watched = topic.services.get(due.service) if topic else None
        if topic is None or watched is None or watched.published or watched.overdue:
            return
        if watched.service.event_driven and watched.appeared:
            return
        if time >= watched.due:
            self._miss(topic, watched, time)
        if not watched.overdue and watched.due < inf:
            self._board.agenda.bring_forward(due, watched.due)

    def awaited(self, time: float) -> List[Told]:
        """Return what is to be told of whom is waited for: once."""
        awaited = self._awaited
        if awaited:
            self._awaited = ""
        what = "No node of the SOM is there yet. Waiting for"
        return [Told(time, f"{what}: {awaited}")] if awaited else []

    def _soon(self, watched: WatchedService) -> float:
        """Return when a message of a node that is there already is missed."""
        wait = 0.0 if watched.service.event_driven else watched.deadline
        connecting = RECONNECT_S + SUBSCRIBE_S * len(self._board.topics)
        return watched.formerly[1] + wait + connecting

    def _miss(self, topic: WatchedTopic, watched: WatchedService, time: float) -> None:
        formerly, told = watched.formerly
        there = formerly in topic.publishers and topic.publishers[formerly].connected
        alibi = decide(
            Case(
                Blame.START,
                time,
                began=told,
                short=self._around.short(formerly) if there else -inf,
                together=len(self._unheard()) if formerly else 1,
                subscribed=topic.subscribed,
                robot_came=self._robot_came,
                formerly=bool(formerly),
            )
        )
        if alibi is None:
            self._blame(topic, watched, time)
            return
        if alibi.why == NOBODY_CAME and self._awaited is None:
            self._awaited = ", ".join(
                f"{each.name} from {watched.service.node}"
                for each in self._board.topics.values()
                for watched in each.services.values()
            )
        again = RECONNECT_S if formerly else self._grace
        watched.due = min(alibi.until, time + again) if topic.subscribed else inf

    def _blame(self, topic: WatchedTopic, watched: WatchedService, time: float) -> None:
        board, (formerly, told) = self._board, watched.formerly
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and nobody.state is FAILED and nobody.since == time:
            watched.due = time + SUBSCRIBE_S  # one row at a time says for which service
            return
        watched.overdue = True
        connected = [p for p in topic.publishers.values() if p.watched is watched]
        guilty = [p for p in connected if p.connected and not board.may_be_silent(topic, p)]
        blamed = min(guilty, key=lambda p: p.name != watched.service.node, default=None)
        if blamed is None:
            blamed = board.miss(topic, formerly, time) if formerly else board.expect(topic, time)
            blamed.provide(watched)
        what = "publisher" if watched.service.event_driven else "message"
        detail = f"no {what} in the first {self._grace:g} s"
        if formerly:
            detail = f"no {what} for {time - told:.3f} s, since this monitor listens"
        board.fail(topic, blamed, time, Kind.NEVER_PUBLISHED, detail)

    def _unheard(self) -> List[str]:
        """Return the nodes that did well under a former monitor, and were not heard yet."""
        topics = self._board.topics.values()
        services = [each for topic in topics for each in topic.services.values()]
        return sorted({each.formerly[0] for each in services if not each.published} - {""})

"""Blames who has never been there: at the start, and after another monitor."""
from math import inf

from shsa_core.model.kinds import Kind
from shsa_core.monitoring.alibis import NOBODY_CAME, Blame, Case, decide
from shsa_core.monitoring.board import FAILED, Board
from shsa_core.monitoring.events import FormerlyHealthy
from shsa_core.monitoring.publishers import NOBODY, WatchedService, WatchedTopic
from shsa_core.monitoring.settings import RECONNECT_S, SUBSCRIBE_S, TOGETHER_S
from shsa_core.monitoring.surroundings import Surroundings


class StartUp:
    """Waits for the first message of each service, `grace` s at most. Times in s.

    A robot that is not there at all is awaited, and nobody is blamed. Who did well under a former
    monitor is there already, and is missed soon.
    """

    def __init__(self, board: Board, grace: float, around: Surroundings) -> None:
        self._board, self._grace, self._around = board, grace, around
        self._robot_came = self._told = False

    def came(self) -> None:
        """Note that somebody is there who is no substitute: the others have their time from now."""
        if not self._robot_came:
            self._robot_came = True
            for topic in self._board.topics.values():
                for watched in topic.services.values():
                    watched.due = max(watched.due, self._board.now + self._grace)

    def expect(self, event: FormerlyHealthy) -> None:
        """Miss those soon that did well under a former monitor."""
        self._robot_came = self._robot_came or bool(event.publishers)
        for name, publisher in event.publishers:
            topic = self._board.topics.get(name)
            watched = self._board.watched_of(topic, publisher) if topic else None
            if not topic or not watched or watched.published or watched.overdue:
                continue
            watched.formerly = publisher, event.time
            if topic.subscribed:
                self._await(watched, min(watched.due, self._soon(watched)))

    def subscribed(self, topic: WatchedTopic) -> None:
        """Give who publishes a topic its time from now on."""
        topic.subscribed = True
        for watched in topic.services.values():
            publisher, _ = watched.formerly
            if publisher:
                watched.formerly = publisher, self._board.now
            self._await(watched, self._soon(watched) if publisher else self._later())

    def left(self, topic: WatchedTopic) -> None:
        """Await somebody as at the start: nobody is left on a topic, and nobody is blamed.

        So it is where substitutes end whose original died before this monitor started.
        """
        for watched in topic.services.values():
            if watched.published or watched.appeared:
                watched.published = watched.appeared = watched.overdue = False
                self._await(watched, self._later())

    def judge(self, watched: WatchedService) -> None:
        """Blame somebody if a service has never been there, once its time is over."""
        topic = self._board.topics.get(watched.service.topic)
        if topic is None or topic.services.get(watched.service.name) is not watched:
            return
        if not (topic.subscribed and watched.is_awaited):
            return
        if self._board.now >= watched.due:
            self._miss(topic, watched)
        if not watched.overdue:
            self._await(watched, watched.due)

    def _await(self, watched: WatchedService, due: float) -> None:
        """Miss a service if nobody was there for it by `due`."""
        watched.due = due
        self._board.agenda.bring_forward(watched, due)

    def _later(self) -> float:
        return self._board.now + self._grace

    def _soon(self, watched: WatchedService) -> float:
        """Return when a message of a node that is there already is missed."""
        wait = 0.0 if watched.service.event_driven else watched.deadline
        connecting = RECONNECT_S + SUBSCRIBE_S * len(self._board.topics)
        return watched.formerly[1] + wait + connecting

    def _miss(self, topic: WatchedTopic, watched: WatchedService) -> None:
        (formerly, told), time = watched.formerly, self._board.now
        there = formerly in topic.publishers and topic.publishers[formerly].connected
        alibi = decide(
            Case(
                Blame.START,
                time,
                began=told,
                limit=told + TOGETHER_S if formerly else inf,
                short=self._around.short(formerly) if there else -inf,
                together=self._unheard() if formerly else 1,
                robot_came=self._robot_came,
                formerly=bool(formerly),
            )
        )
        if alibi is None:
            self._blame(topic, watched)
            return
        if alibi.why == NOBODY_CAME and not self._told:
            self._told = True
            all_ = (
                each for topic in self._board.topics.values() for each in topic.services.values()
            )
            named = ", ".join(f"{each.service.topic} from {each.service.node}" for each in all_)
            text = f"No node of the SOM is there yet. Waiting for: {named}"
            self._board.warn(text)
        again = RECONNECT_S if formerly else self._grace
        watched.due = min(alibi.until, time + again)

    def _blame(self, topic: WatchedTopic, watched: WatchedService) -> None:
        board, (formerly, told), time = self._board, watched.formerly, self._board.now
        nobody = topic.publishers.get(NOBODY)
        if nobody is not None and nobody.state is FAILED and nobody.since == time:
            watched.due = time + SUBSCRIBE_S  # one row at a time says for which service
            return
        watched.overdue = True
        connected = [p for p in topic.publishers.values() if p.watched is watched]
        guilty = [p for p in connected if p.connected and not board.may_be_silent(p)]
        blamed = min(guilty, key=lambda p: p.name != watched.service.node, default=None)
        if blamed is None:
            blamed = board.miss(topic, formerly) if formerly else board.expect(topic)
            blamed.provide(watched)
        what = "publisher" if watched.service.event_driven else "message"
        detail = f"no {what} in the first {self._grace:g} s"
        if formerly:
            detail = f"no {what} for {time - told:.3f} s, since this monitor listens"
        board.fail(blamed, Kind.NEVER_PUBLISHED, detail)

    def _unheard(self) -> int:
        """Count the nodes that did well under a former monitor, and were not heard yet."""
        topics = self._board.topics.values()
        services = [each for topic in topics for each in topic.services.values()]
        return len({each.formerly[0] for each in services if not each.published} - {""})

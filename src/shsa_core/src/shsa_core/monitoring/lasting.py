"""Which failures last, and the message from which a substitute goes on: for whoever hears late."""
from typing import Dict, Iterable, List, Tuple

from shsa_core.model.names import RecentNames
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import FailureDetected, Key, PublisherHealth, PublisherState
from shsa_core.monitoring.last_messages import LastMessages


class LastingFailures:
    """Each failure until its publisher is well again, or forgotten.

    A reconfigurator that is started later hears of what failed before, and gets the newest message
    of the substitute that stood in: it could not know where a position is, nor the frames.
    """

    def __init__(self) -> None:
        self.messages = LastMessages()
        self._lasting: Dict[Key, FailureDetected] = {}
        self._substitutes = RecentNames()  # each is used once
        self._stand_ins: Dict[str, str] = {}  # by service: who computed it last

    def add(self, failure: FailureDetected) -> bytes:
        """A new failure; the last good message before it, empty if none was kept.

        That of a substitute does not last: it ends with its reconfigurator.
        """
        if failure.service and failure.publisher not in self._substitutes:
            self._lasting[failure.topic, failure.publisher] = failure
        return self._last_good(failure)

    def health(self, rows: Iterable[PublisherHealth], removed: Iterable[Key]) -> None:
        """What is well again, or forgotten, lasts no longer."""
        well = [row.key for row in rows if row.state is not PublisherState.FAILED]
        for key in (*well, *removed):
            self._lasting.pop(key, None)

    def substitutions(self, rows: Iterable[Substitution]) -> None:
        """Who stands in for whom; safe values tell nothing of the robot."""
        for row in (row for row in rows if row.node):  # the others are plans
            self._substitutes.add(row.node)
            if row.publishing and row.quality > 0.0:
                self._stand_ins[row.service] = row.node

    def all(self, now: float) -> List[Tuple[FailureDetected, bytes]]:
        """The failures that last, each with the newest message that is known."""
        return [
            (failure, self._newest(failure, now) or self._last_good(failure))
            for failure in self._lasting.values()
        ]

    def _newest(self, failure: FailureDetected, now: float) -> bytes:
        node = self._stand_ins.get(failure.service)
        return self.messages.newest(failure.topic, node, now, now) if node else b""

    def _last_good(self, failure: FailureDetected) -> bytes:
        newest = self.messages.newest
        return newest(failure.topic, failure.publisher, failure.last_good, failure.time)

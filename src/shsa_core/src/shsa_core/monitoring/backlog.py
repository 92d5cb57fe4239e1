"""What a publisher sent while it could not be heard: it comes all at once, and late.

So it is where a link to another computer was down. Such messages say nothing of how the publisher
does: they are as old as the silence was, and come faster than it ever publishes.
"""
import math
from typing import Optional

from shsa_core.monitoring.events import Message

MISSED_SHARE = 0.5
"""Of the period: messages that come sooner after each other have waited somewhere."""


class Backlog:
    """Tells the messages of one publisher that it sent before or during a silence."""

    def __init__(self) -> None:
        self._age: Optional[float] = None  # of its messages as they come, in s
        self._catches_up = False
        self._until = -math.inf

    def holds(
        self, message: Message, previous: Optional[float], allowed: float, period: Optional[float]
    ) -> bool:
        """Whether a message tells of the past; `previous`: when the one before it came.

        After a silence of more than `allowed` s a message counts once its stamp is about as old as
        usual, and it comes half a period after another one. Where no stamp tells, the first of
        them might be old. What comes old for longer than the silence was is no backlog: a clock
        was set.
        """
        if previous is None or period is None:
            return self._count(message)
        passed = message.time - previous
        began = passed - message.waited > allowed
        self._catches_up = self._catches_up or began
        if began:
            self._until = message.time + passed
        if not self._catches_up:
            return self._count(message)
        late = began
        if message.age is not None and self._age is not None:
            late = message.age - self._age > allowed and message.time < self._until
        if late or passed < MISSED_SHARE * period:
            return True
        return self._count(message)

    def _count(self, message: Message) -> bool:
        self._catches_up = False
        if message.age is not None:
            self._age = message.age
        return False

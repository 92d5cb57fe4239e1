"""Tells what a publisher sent while it could not be heard, as where a link was down."""
from math import inf
from typing import Optional

BURST_PERIODS = 0.5
"""Messages that come sooner after each other have waited somewhere."""


class Backlog:
    """The messages of one publisher, which come all at once after a silence. Times in s."""

    def __init__(self) -> None:
        self._came = inf
        self._age: Optional[float] = None  # of its messages as they come
        self._catches_up = False
        self._until = -inf

    def holds(
        self,
        time: float,
        age: Optional[float],
        allowed: float,
        waited: float = 0.0,
        period: float = 0.0,
    ) -> bool:
        """Tell if a message tells of the past; `age`: by its stamp, None: it has none.

        After a silence of more than `allowed` s a message counts once its stamp is about as old as
        usual, and it comes half a `period` after another one. Where no stamp tells, the first of
        them might be old. What comes old for longer than the silence was is no backlog: a clock
        was set. It may have `waited` for us.
        """
        passed, self._came = time - self._came, time
        began = passed - waited > allowed
        if began:
            self._catches_up, self._until = True, time + passed
        if self._catches_up:
            late = began
            if age is not None and self._age is not None:
                late = age - self._age > allowed and time < self._until
            if late or passed < BURST_PERIODS * period:
                return True
        self._catches_up = False
        self._age = self._age if age is None else age
        return False

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
        self.owed = 0.0  # for so long may a silence have held the newest message up
        self.makes_up = False  # what was held up comes at twice its rate, at least
        self._due = inf
        self._ended = self._first_due = self._lapses = -inf

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
        them might be old. What comes old, or fast, for longer than the silence was is no backlog:
        a clock was set, or it babbles. It may have `waited` for us.
        """
        self._owe(time, period)
        passed, self._came = time - self._came, time
        began = passed - waited > allowed
        if began:
            self._catches_up, self._until = True, time + passed
        if self._catches_up:
            late = began
            if age is not None and self._age is not None:
                late = age - self._age > allowed
            if time < self._until and (late or passed < BURST_PERIODS * period):
                return True
        self._catches_up = False
        self._age = self._age if age is None else age
        return False

    def _owe(self, time: float, period: float) -> None:
        """Count a message as the next one due in a silence, for as long as that was."""
        if time >= self._lapses:
            self._due, self._ended = self._came, time
            self._lapses = time + (time - self._came)
            self._first_due = min(time, self._due + period)
        self._due = min(time, self._due + period)
        self.owed = time - self._due
        self.makes_up = time - self._ended <= BURST_PERIODS * (self._due - self._first_due)

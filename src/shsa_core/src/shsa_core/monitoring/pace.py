"""The time by which publishers are judged: ours, or no more of it than /clock lets pass.

Under simulated time a node that follows /clock publishes as slowly as that goes, and stands still
while it does; one that does not follow it goes on as ever. Nobody can tell which is which, so each
is judged by the clock that speaks for it: silence and low rates by the slower one, high rates by
the faster one.
"""
from dataclasses import replace
from typing import Optional

from shsa_core.monitoring.events import ClockTicked, Event, Message
from shsa_core.monitoring.settings import AGE_LEAST_S


class Pace:
    """Turns our moments into those that publishers are judged by, and back. Times in s."""

    def __init__(self) -> None:
        self._tick: Optional[ClockTicked] = None
        self._slow = self._fast = self._now = self._ahead = 0.0
        self.jumped = False
        """The computer's own clock was set before the last look at it."""

    @property
    def simulated(self) -> bool:
        """True if there is a /clock to follow."""
        return self._tick is not None and self._tick.simulated

    def _look(self, tick: ClockTicked) -> None:
        """Look at both clocks."""
        before, self._tick, self.jumped, self._ahead = self._tick, tick, False, 0.0
        if before is None or before.simulated is not tick.simulated:
            self._slow = self._fast = tick.time
            return
        ours, theirs = tick.time - before.time, tick.ros_time - before.ros_time
        self._slow += min(ours, max(0.0, theirs))
        self._ahead = max(0.0, theirs - ours)
        self._fast += ours + self._ahead
        self.jumped = not tick.simulated and abs(theirs - ours) > AGE_LEAST_S / 2.0

    def judged(self, event: Event) -> Event:
        """Return an event at the time by which it is judged."""
        if isinstance(event, ClockTicked):
            self._look(event)
        self._now, tick = event.time, self._tick
        if tick is None or not tick.simulated:
            return event
        if isinstance(event, Message):
            apart = self._fast - self._slow + event.time - tick.time
            # It waited since the look before, by the faster clock.
            return replace(event, time=self._slow, apart=apart, waited=event.waited + self._ahead)
        return replace(event, time=self._slow)

    def ours(self, moment: float) -> float:
        """Return a moment at our time, as of now; one to come can be reached then at the earliest.

        What lies back does so by the publisher's clock.
        """
        return self._now + (moment - self._slow) if self.simulated else moment

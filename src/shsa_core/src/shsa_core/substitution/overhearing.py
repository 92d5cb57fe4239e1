"""The others who publish on a substitute's topic, and for how long they have been silent."""
import math
from typing import Optional

from shsa_core.substitution.events import OtherHeard
from shsa_core.watch import Watch


class Overhearing:
    """Measures the silence of the others on `topic`, which is empty where none is heard.

    `last`: the newest message of theirs, None: none so far. Times in s.
    """

    def __init__(self) -> None:
        self.watch = Watch()
        self.topic = ""
        self.last: Optional[OtherHeard] = None
        self._since = -math.inf

    def listen(self, topic: str) -> None:
        """Hear the others on a topic from now on; on another one nobody was heard yet."""
        if topic != self.topic:
            self.last, self._since = None, self.watch.now
        self.topic = topic

    def heard(self, event: OtherHeard) -> bool:
        """Take a message of somebody else; tell if it is on our topic."""
        if not self.topic or event.topic != self.topic:
            return False
        self.last, self._since = event, self.watch.now
        return True

    @property
    def silence(self) -> float:
        """The time for which they have been silent."""
        return self.watch.passed(self._since)

    def are_silent(self, length: float) -> bool:
        """Tell if they have been silent for so long."""
        return self.watch.has_passed(self._since, length)

    def silent_at(self, length: float) -> float:
        """Return when they will have been silent for so long."""
        return self.watch.when(self._since, length)

"""What was refused of what others sent: counted, said once a minute, shown to people."""
import threading
import time
from typing import Dict, List, Tuple

import rospy

PAUSE_S = 60.0
"""At least between two lines of the log on one sender."""
SENDERS = 100
"""So many are told apart."""
LONGEST_NAME = 100
ANYBODY = "others"

Key = Tuple[str, str, str]


class Refusals:
    """Refused messages by topic, by the name that their sender claims, and by the reason."""

    def __init__(self) -> None:
        self._counts: Dict[Key, int] = {}
        self._said: Dict[Key, float] = {}
        self._lock = threading.Lock()

    def note(self, topic: str, sender: str, why: str) -> None:
        """A message was refused; from any thread."""
        key = topic, ascii(sender[:LONGEST_NAME])[1:-1], why
        now = time.monotonic()
        with self._lock:
            if key not in self._counts and len(self._counts) >= SENDERS:
                key = topic, ANYBODY, why
            self._counts[key] = self._counts.get(key, 0) + 1
            if now < self._said.get(key, -PAUSE_S) + PAUSE_S:
                return
            self._said[key] = now
            count = self._counts[key]
        text = "Refused a message on %s from who calls itself %s: %s (%d so far)."
        rospy.logwarn(text, topic, key[1], why, count)

    def counts(self) -> List[Tuple[str, int]]:
        """How many there were so far, each with topic, sender and reason."""
        with self._lock:
            return [(f"{t} from {s}: {why}", n) for (t, s, why), n in self._counts.items()]

"""What others publish on a substitute's topic: when they were heard last, by an honest watch."""
from typing import Optional

from shsa_core.silence import Silence
from shsa_core.substitution.events import OtherHeard


class Overhearing(Silence):
    """How long the others on a topic have been silent; `topic` is empty where none is heard.

    `last`: what was heard last, None: nothing so far.
    """

    def __init__(self) -> None:
        super().__init__()
        self.topic = ""
        self.last: Optional[OtherHeard] = None

    def listen(self, topic: str, matters: float) -> None:
        """Hear the others on a topic from now on; on another one nobody was heard yet."""
        if topic != self.topic:
            self.last, self.silence = None, 0.0
        self.topic, self.matters = topic, matters

    def heard(self, event: OtherHeard) -> bool:
        """Somebody else has published; whether it is on our topic."""
        if not self.topic or event.topic != self.topic:
            return False
        self.last, self.silence = event, 0.0
        return True

"""An incident: one failure of a topic from its first sign to its end."""
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Dict, Optional, Tuple


class State(str, Enum):
    """Where an incident stands; the values are those of shsa_msgs/Incident."""

    HEALING = "healing"
    HEALED = "healed"
    RETURNING = "returning"
    UNHEALED = "unhealed"
    SAFE = "safe"
    ENDED = "ended"


@dataclass(frozen=True)
class Incident:
    """The record of a failure and its repair. All times in s on one clock; None: has not happened.

    `last_good` is the last good message on the topic before the latest outage. `restarts`: how often the faulty
    node was started again. `kept_out`: it may not return until somebody releases the topic.
    """

    id: int
    topic: str
    properties: Tuple[str, ...]
    faulty_node: str
    kind: str
    detail: str
    detected: float
    state: State = State.HEALING
    last_good: Optional[float] = None
    killed: Optional[float] = None
    found: Optional[float] = None
    spawned: Optional[float] = None
    first_message: Optional[float] = None
    returned: Optional[float] = None
    ended: Optional[float] = None
    substitute: str = ""
    inputs: Tuple[str, ...] = ()
    code: str = ""
    outputs: Tuple[str, ...] = ()
    relations: Tuple[str, ...] = ()
    quality: float = 0.0
    missing: Tuple[str, ...] = ()
    restarts: int = 0
    kept_out: bool = False

    @property
    def outage(self) -> Optional[float]:
        """Seconds without a good message: from the last good one to the substitute's first."""
        if self.first_message is None or self.last_good is None:
            return None
        return self.first_message - self.last_good

    def as_dict(self) -> Dict[str, object]:
        """The record as plain values, as one line of the incident log has it."""
        record = asdict(self)
        record["state"] = self.state.value
        record["outage"] = self.outage
        return record

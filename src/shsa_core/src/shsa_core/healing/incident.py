"""An incident: one failure of a service from its first sign to its end."""
from dataclasses import asdict, dataclass
from typing import Dict, Optional, Tuple

from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind, Word


class State(Word):
    """The state of a service: WELL, or where its incident stands, as in shsa_msgs/Incident."""

    WELL = "well"
    HEALING = "healing"
    HEALED = "healed"
    RETURNING = "returning"
    UNHEALED = "unhealed"
    SAFE = "safe"
    KEPT = "kept"
    ENDED = "ended"


SUBSTITUTED = (State.HEALING, State.HEALED)
STUCK = (State.UNHEALED, State.SAFE)
WAITING = (*STUCK, State.KEPT)


class Trigger(Word):
    """Causes of a change of the state of a service."""

    FAILED = "its node failed"
    SUBSTITUTE_FAILED = "substitute failed"
    FIRST_MESSAGE = "first message of the substitute"
    SILENT = "silent while its program changes"
    LATE = "first message is late"
    NO_VALUE = "its law does not hold"
    OUTGROWN = "it errs too much by now, or clearly more than another plan"
    RETURNED = "its node is back"
    STEADY = "healthy for the hold-off"
    RETRY = "a pause is over"
    REPLAN = "another plan or decision may be best"
    WITHDRAWN = "no longer in the SOM"


@dataclass(frozen=True)
class Incident:
    """The record of a failure and its repair.

    All times in s on one clock; None: has not happened.

    `evidence` is what was seen when it was detected, `detail` what happened last, in words.
    `last_good` is the last good message of the service before the latest outage. `quality` is None
    without a substitute, and where that publishes safe values, which promise nothing; `errors` are
    what is expected of each output, in the unit of its property, None: not known. `unavailable`:
    the other services that nothing could be derived from when it was searched last. `restarts`:
    how often the faulty node was started again. `kept_out`: it may not return until somebody
    releases the service. `kept`: the faulty node was not killed; `decision` says why it was, or was
    not.
    """

    id: int
    service: str
    topic: str
    properties: Tuple[str, ...]
    faulty_node: str
    kind: Kind
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
    gains: Tuple[float, ...] = ()
    offsets: Tuple[float, ...] = ()
    quality: Optional[float] = None
    errors: Tuple[Optional[Error], ...] = ()
    missing: Tuple[str, ...] = ()
    unavailable: Tuple[str, ...] = ()
    restarts: int = 0
    kept_out: bool = False
    kept: bool = False
    decision: str = ""
    evidence: str = ""

    @property
    def outage(self) -> Optional[float]:
        """Seconds without a good message: from the last good one to the substitute's first."""
        if self.first_message is None or self.last_good is None:
            return None
        return self.first_message - self.last_good

    def as_dict(self) -> Dict[str, object]:
        """The record as plain values, as one line of the incident log has it."""
        words = {"state": self.state.value, "kind": self.kind.value}
        return {**asdict(self), **words, "outage": self.outage}


WELL = Incident(0, "", "", (), "", Kind.OTHER, "", 0.0, State.WELL)
"""No incident."""

"""The table of health: how each publisher of each topic does. Times in s."""
from dataclasses import dataclass
from typing import Optional, Tuple

from shsa_core.model.kinds import Kind, Word

Key = Tuple[str, str]
"""A topic and one of its publishers: the unit of health and of blame."""


class PublisherState(Word):
    """The state of a publisher; see shsa_msgs/PublisherHealth."""

    UNKNOWN = "unknown"
    HEALTHY = "healthy"
    FAILED = "failed"


@dataclass(frozen=True)
class PublisherHealth:
    """One row of the monitor's table: the state since `since`; `kind` of failure, if it failed.

    `detail`: what was seen and what is allowed; of one that has not failed: why it is not blamed
    or not read, or what is doubtful or unusual. `last_message`: of one that failed, the serialized
    message from which a substitute goes on; empty: not known. `uri`: the address of the
    process that was heard.
    """

    topic: str
    publisher: str
    state: PublisherState
    since: float
    first_message: Optional[float] = None
    last_good: Optional[float] = None
    kind: Optional[Kind] = None
    detail: str = ""
    service: str = ""
    last_message: bytes = b""
    uri: str = ""

    @property
    def is_well(self) -> bool:
        """True while it is healthy."""
        return self.state is PublisherState.HEALTHY

    @property
    def has_failed(self) -> bool:
        """True from its failure until it has recovered."""
        return self.state is PublisherState.FAILED

    @property
    def key(self) -> Key:
        """The row's topic and publisher."""
        return self.topic, self.publisher

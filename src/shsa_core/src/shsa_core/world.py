"""What the healing of one topic may ask about the rest of the robot."""
from dataclasses import dataclass
from typing import Collection, List, Protocol, Tuple, Optional

from shsa_core.codegen import Program
from shsa_core.events import Command, PublisherHealth
from shsa_core.plans import TopicPlan


@dataclass(frozen=True)
class Settings:
    """The reconfigurator's settings; times in s.

    `hold_off`: how long a returned original must stay healthy before the substitute is stopped.
    `start_timeout`: how long a substitute may take from its start to its first message.
    `restarts`: how often a substitute that died is started again with the same plan.
    `retry`: after how long a topic that could not be healed is tried anew; doubles up to `retry_limit`.
    `method`: the search, `best` or `orr`.
    `pool`: how many idle processes the warm topics share.
    """

    hold_off: float = 2.0
    start_timeout: float = 5.0
    restarts: int = 2
    retry: float = 2.0
    retry_limit: float = 60.0
    method: str = "best"
    pool: int = 2


class World(Protocol):
    """What the healing of a topic may ask about the rest of the robot."""

    settings: Settings

    def plan(self, topic: str, tried: Collection[TopicPlan]) -> TopicPlan:
        """The best substitute of `topic` from what is available, other than those tried."""

    def usable(self, plan: TopicPlan) -> bool:
        """Whether every service that `plan` reads is available."""

    def originals(self, topic: str) -> Tuple[PublisherHealth, ...]:
        """The health of the publishers of `topic` that are not substitutes."""

    def publisher(self, topic: str, node: str) -> Optional[PublisherHealth]:
        """The health of `node` on `topic`."""

    def provider(self, topic: str) -> str:
        """The node that the SOM names for `topic`."""

    def properties(self, topic: str) -> Tuple[str, ...]:
        """The properties that `topic` provides."""

    def kill(self, node: str, urgent: bool) -> List[Command]:
        """The command that kills `node`; none if that is under way."""

    def dying(self, node: str) -> bool:
        """Whether the kill of `node` is under way."""

    def new_incident(self) -> int:
        """The next incident's number."""

    def hot(self, topic: str) -> bool:
        """Whether a substitute of `topic` computes before it is needed."""

    def plan_ahead(self, topic: str) -> TopicPlan:
        """The best substitute of `topic` if the node that publishes it failed. Raises ShsaError."""

    def process(self, topic: str, program: Program) -> Tuple[str, Command]:
        """A process for a substitute: its node name, and the command that sets it to work."""

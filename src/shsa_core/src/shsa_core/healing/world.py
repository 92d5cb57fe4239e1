"""What the healing of one topic may ask about the rest of the robot."""
from typing import Collection, List, Protocol, Tuple, Optional

from shsa_core.codegen.generator import Program
from shsa_core.healing.events import Command, PublisherHealth
from shsa_core.healing.plans import TopicPlan
from shsa_core.healing.settings import Settings


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

    def policy(self, topic: str) -> str:
        """What is done about a failure of `topic`; see shsa_core.model.policies."""

    def safe_plan(self, topic: str) -> Optional[TopicPlan]:
        """The plan that publishes the safe values of `topic`; None if it has none."""

    def command(self, topic: str) -> Tuple[str, ...]:
        """The command that is run when nothing can substitute `topic`; empty if it has none."""

    def kill(self, node: str, urgent: bool) -> List[Command]:
        """The command that kills `node`; none if that is under way."""

    def restart(self, node: str) -> List[Command]:
        """The command that starts `node` again; none if that is under way for another of its topics."""

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

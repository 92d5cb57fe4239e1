"""The monitor's settings, where a service has none of its own."""
from dataclasses import dataclass

from shsa_core.model.service import Deadlines


@dataclass(frozen=True)
class Settings:
    """The monitor's settings.

    `startup_grace`: s until a service that has never been there has failed.
    `deadline`: periods without a message after which a publisher is silent.
    `minimum_deadline`: s; the least silence that it is blamed for by that.
    `reconnect`: s within which a node whose connection was lost, and which lives, must give another
    one.
    """

    startup_grace: float = 15.0
    deadline: float = Deadlines.periods
    minimum_deadline: float = Deadlines.minimum
    reconnect: float = 0.5

    @property
    def deadlines(self) -> Deadlines:
        """How long a service may be silent."""
        return Deadlines(self.deadline, self.minimum_deadline)

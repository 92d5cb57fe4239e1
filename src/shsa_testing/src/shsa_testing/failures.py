"""The failures in what the monitor's core says."""
from typing import Iterable, List

from shsa_core.model.health import PublisherHealth
from shsa_core.monitoring.events import Command, HealthChanged


def failures_in(commands: Iterable[Command]) -> List[PublisherHealth]:
    """Return the rows of the table of health that tell of new failures."""
    changes = (each for each in commands if isinstance(each, HealthChanged))
    return [row for change in changes for row in change.failed]

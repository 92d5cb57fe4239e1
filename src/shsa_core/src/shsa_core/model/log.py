"""A line of the log, as every core says it."""
from dataclasses import dataclass

from shsa_core.model.kinds import Word


class Level(Word):
    """The urgency of a line of the log."""

    INFO = "info"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True)
class Log:
    """Tell people, in plain words."""

    level: Level
    text: str

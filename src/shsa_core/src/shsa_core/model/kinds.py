"""The words that files, messages and the core share.

Kinds of failure, and what a service may ask for.
"""
from enum import Enum


class Word(str, Enum):
    """An enumeration of plain words, each equal to its text."""

    def __str__(self) -> str:
        return str(self.value)


class Kind(Word):
    """What was wrong with a publisher; see shsa_msgs/Failure.

    Those with a class in `checks` can be tuned.
    """

    NODE_GONE = "node_gone"
    SILENT = "silent"
    NEVER_PUBLISHED = "never_published"
    OUT_OF_RANGE = "out_of_range"
    NOT_A_NUMBER = "not_a_number"
    RATE_HIGH = "rate_high"
    RATE_LOW = "rate_low"
    STUCK = "stuck"
    JUMP = "jump"
    STALE_STAMP = "stale_stamp"
    FUTURE_STAMP = "future_stamp"
    UNKNOWN_PUBLISHER = "unknown_publisher"
    REQUESTED = "requested"
    OTHER = "other"


class Standby(Word):
    """What is ready before a service fails."""

    COLD = "cold"
    WARM = "warm"
    HOT = "hot"


class Policy(Word):
    """What is done about the node of a failed service."""

    SUBSTITUTE = "substitute"
    RESTART = "restart"
    RESTART_AND_SUBSTITUTE = "restart_and_substitute"

    @property
    def substitutes(self) -> bool:
        """Whether a substitute takes the service over."""
        return self is not Policy.RESTART

    @property
    def restarts(self) -> bool:
        """Whether the node is started again."""
        return self is not Policy.SUBSTITUTE

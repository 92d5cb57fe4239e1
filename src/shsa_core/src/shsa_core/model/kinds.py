"""The words that files, messages and the core share.

Kinds of failure, and what a service may ask for.
"""
from enum import Enum


class Word(str, Enum):
    """An enumeration of plain words, each equal to its text."""

    def __str__(self) -> str:
        return str(self.value)


class Kind(Word):
    """A kind of failure of a publisher; see shsa_msgs/Failure.

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
    WITNESS = "witness"
    STALE_STAMP = "stale_stamp"
    FUTURE_STAMP = "future_stamp"
    FRAME = "frame"
    LENGTH = "length"
    FORMULA = "formula"
    UNKNOWN_PUBLISHER = "unknown_publisher"
    NO_VALUE = "no_value"
    REQUESTED = "requested"
    OTHER = "other"


QUIET = (Kind.NODE_GONE, Kind.SILENT, Kind.NEVER_PUBLISHED)
"""The failures of a publisher that says nothing; any other one may still be heard."""

BY_LINK = (Kind.SILENT, Kind.NEVER_PUBLISHED, Kind.RATE_LOW, Kind.RATE_HIGH)
"""The failures that a bad link shows of a node on another computer that does well."""

BY_CLOCK = (Kind.STALE_STAMP, Kind.FUTURE_STAMP)
"""The failures that a clock shows that was set, on another computer, of a node that does well."""


class Contain(Word):
    """The node of a failed service is killed, or never, where the SOM decides that."""

    NODE = "node"
    NONE = "none"


class Standby(Word):
    """The substitute that is ready before a service fails."""

    COLD = "cold"
    WARM = "warm"
    HOT = "hot"


class Policy(Word):
    """The reaction to the failure of a service."""

    SUBSTITUTE = "substitute"
    RESTART = "restart"
    RESTART_AND_SUBSTITUTE = "restart_and_substitute"
    ADVISE = "advise"

    @property
    def substitutes(self) -> bool:
        """A substitute takes the service over."""
        return self in (Policy.SUBSTITUTE, Policy.RESTART_AND_SUBSTITUTE)

    @property
    def plans(self) -> bool:
        """A substitute is looked for: to take the service over, or to be advised of."""
        return self is not Policy.RESTART

    @property
    def restarts(self) -> bool:
        """The node is started again."""
        return self in (Policy.RESTART, Policy.RESTART_AND_SUBSTITUTE)


class Method(Word):
    """The search for a substitute; ORR is the paper's word for DEPTH_FIRST."""

    BEST = "best"
    DEPTH_FIRST = "depth_first"
    ORR = "orr"


class OnPartition(Word):
    """The reaction while it is the computer of a service that cannot be reached.

    WAIT: nothing, until that is back: the node may still serve those on its side.
    """

    HEAL = "heal"
    WAIT = "wait"


class Others(Word):
    """The values of the fields of a message that a substitute does not compute.

    Names, sizes and settings are always as in the last good message. What was measured is marked as
    unknown as its type defines it, or is as it was in that message, or is zero.
    """

    UNKNOWN = "unknown"
    LAST = "last"
    ZERO = "zero"

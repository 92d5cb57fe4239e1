"""What the reconfigurator hears of the robot's computers, and where on them a node is found.

Of another computer by its agent, a node of healing that runs there.
"""
from dataclasses import dataclass

from shsa_core.model.kinds import Word


class Where(Word):
    """Where the process of a node runs, as far as can be told.

    UNKNOWN: it cannot be verified which process it is. ANOTHER: it is not the one that failed.
    UNREACHABLE: its computer was lost, so that nothing can be said of it.
    """

    HERE = "here"
    STOPPED = "stopped"
    DEAD = "dead"
    ELSEWHERE = "elsewhere"
    NOWHERE = "nowhere"
    UNKNOWN = "unknown"
    ANOTHER = "another"
    UNREACHABLE = "unreachable"


@dataclass(frozen=True)
class HostSeen:
    """The agent of a computer tells that it is there, again and again.

    `load`: how many of its `cores` are busy; `sent` and `received`: bytes/s on its network.
    """

    time: float
    host: str
    load: float
    cores: float
    sent: float = 0.0
    received: float = 0.0


@dataclass(frozen=True)
class HostLost:
    """The agent of a computer is not heard any more; `detail`: what was seen of that."""

    time: float
    host: str
    detail: str

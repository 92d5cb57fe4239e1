"""What the reconfigurator hears of the robot's other computers.

Of each by its agent, a node of healing that runs there.
"""
from dataclasses import dataclass


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

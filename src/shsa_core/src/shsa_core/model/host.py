"""The robot's computers, and where a substitute of a service may run."""
from dataclasses import dataclass
from typing import Optional, Tuple


@dataclass(frozen=True)
class Host:
    """One computer of the robot.

    `cores`: how many CPUs it has; `link`: what its network carries, in bytes/s. None: not known, so
    that nothing is refused for it.
    """

    name: str
    cores: Optional[float] = None
    link: Optional[float] = None


@dataclass(frozen=True)
class Placement:
    """Hosts by name: where a substitute rather runs, best first, and where it never does."""

    prefer: Tuple[str, ...] = ()
    forbid: Tuple[str, ...] = ()

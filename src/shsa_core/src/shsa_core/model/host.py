"""The robot's computers, and where a substitute of a service may run."""
from dataclasses import dataclass
from typing import Optional, Tuple


@dataclass(frozen=True)
class Host:
    """One computer of the robot: its CPUs, and what its link carries in bytes/s; None: any."""

    name: str
    cores: Optional[float] = None
    link: Optional[float] = None


@dataclass(frozen=True)
class Placement:
    """Hosts by name: where a substitute rather runs, best first, and where it never does."""

    prefer: Tuple[str, ...] = ()
    forbid: Tuple[str, ...] = ()

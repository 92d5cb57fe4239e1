"""A standing connection to a publisher: what is read from it, cut into messages."""
from dataclasses import dataclass, field
from typing import Any, Dict

from shsa_core.ros.graph.frames import Frames


@dataclass(eq=False)
class Connection:
    """A standing connection to a publisher."""

    topic: str
    publisher: str
    header: Dict[str, str]
    transport: Any
    descriptor: int
    address: str = ""
    frames: Frames = field(default_factory=Frames)

    def read(self) -> bool:
        """Read what has come; whether the connection still stands."""
        connected = self.transport.socket
        if connected is None:
            return False
        try:
            return self.frames.read(connected)
        except OSError:
            return False

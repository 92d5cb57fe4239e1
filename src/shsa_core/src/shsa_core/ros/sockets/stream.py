"""A standing connection to a publisher: what is read from it, cut into messages."""
import socket
from dataclasses import dataclass, field
from typing import Any, Dict

from shsa_core.ros.sockets.frames import Frames


@dataclass(eq=False)
class Connection:
    """A standing connection to a publisher.

    `expects`: bytes that come before the kernel wakes who waits for it; 1: each does.
    """

    topic: str
    publisher: str
    header: Dict[str, str]
    transport: Any
    descriptor: int
    address: str = ""
    frames: Frames = field(default_factory=Frames)
    expects: int = 1

    def read(self) -> bool:
        """Read what has come; whether the connection still stands."""
        connected = self.transport.socket
        if connected is None:
            return False
        try:
            stands = self.frames.read(connected)
            if self.frames.expected != self.expects:
                self.expects = self.frames.expected
                connected.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, self.expects)
        except OSError:
            return False
        return stands

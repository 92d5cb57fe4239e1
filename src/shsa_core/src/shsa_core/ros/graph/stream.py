"""A standing connection to a publisher: what is read from it, cut into messages."""
import struct
from dataclasses import dataclass, field
from typing import Any, Dict, List

LARGEST_MESSAGE = 1 << 28
"""Bytes; what is larger is not kept, and its publisher counts as silent."""
CHUNK = 65536
CHUNKS_A_TURN = 16
"""A babbling publisher must not keep the others waiting."""


@dataclass(eq=False)
class Connection:
    """A standing connection to a publisher."""

    topic: str
    publisher: str
    header: Dict[str, str]
    transport: Any
    descriptor: int
    address: str = ""
    buffer: bytearray = field(default_factory=bytearray)
    skip: int = 0

    def read(self) -> bool:
        """Read what has come; whether the connection still stands."""
        for _ in range(CHUNKS_A_TURN):
            try:
                data = self.transport.socket.recv(CHUNK)
            except BlockingIOError:
                return True
            except (OSError, AttributeError):
                return False
            if not data:
                return False
            self.buffer += data
            if len(data) < CHUNK:
                return True
        return True

    def messages(self) -> List[bytes]:
        """The complete messages that were read, each once."""
        found, start, buffer = [], 0, self.buffer
        while True:
            skipped = min(self.skip, len(buffer) - start)
            start, self.skip = start + skipped, self.skip - skipped
            if len(buffer) < start + 4:
                break
            size: int = struct.unpack_from("<I", buffer, start)[0]
            if size > LARGEST_MESSAGE:
                self.skip = 4 + size
                continue
            end = start + 4 + size
            if len(buffer) < end:
                break
            found.append(bytes(buffer[start + 4 : end]))
            start = end
        del buffer[:start]
        return found

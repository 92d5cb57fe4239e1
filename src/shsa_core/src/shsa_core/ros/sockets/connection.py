"""A standing connection to a publisher: what is read from it, cut into messages."""
import socket
from typing import Any, Dict, Optional, Tuple

import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros.messages.fields import Decoder
from shsa_core.ros.sockets import arrival_times
from shsa_core.ros.sockets.frames import Frames


class Connection:
    """A connection that rospy has made: `transport`.

    `publisher` is whom it claims to be, and a node's name once it `is_known`, which listens at the
    numeric address `at`. What `wakes` ends the sleep of who reads it, as what `is_large` should.
    """

    def __init__(self, topic: str, transport: Any) -> None:
        """Take a connection over; raises OSError if rospy has closed it meanwhile."""
        connected = transport.socket
        connected.setblocking(False)
        arrival_times.enable(connected)
        self.topic, self.publisher = topic, str(transport.callerid_pub)
        self.transport, self.uri = transport, str(transport.endpoint_id)
        self.header: Dict[str, str] = transport.header
        self.descriptor: int = connected.fileno()
        self.host, self.at = _peer(connected), ""
        self.is_known = self.is_large = False
        self.wakes = True
        self.frames = Frames()
        self.expects = 1
        """Bytes that come before the kernel wakes who waits for it; 1: each does."""
        self._decodes: Optional[Tuple[str, Tuple[str, ...]]] = None
        self._decoder: Optional[Decoder] = None

    def read(self) -> bool:
        """Read what has come; return False once the connection has ended."""
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

    def decoder(self, kind: str, fields: Tuple[str, ...]) -> Optional[Decoder]:
        """Return what reads fields of its messages; None, with a warning, if they are no `kind`."""
        if self._decodes != (kind, fields):
            self._decodes, self._decoder = (kind, fields), None
            try:
                self._decoder = Decoder(kind, self.header, fields)
                problems = self._decoder.problems
            except ShsaError as error:
                problems = [str(error)]
            for problem in problems:
                self.warn(problem)
        return self._decoder

    def warn(self, problem: object) -> None:
        """Say why its messages are not read, now and then."""
        text = f"What {self.publisher} publishes on {self.topic} is not read: {problem}"
        rospy.logwarn_throttle_identical(60.0, text)


def _peer(connected: socket.socket) -> str:
    """Return the address of the other end; empty if it has gone already."""
    try:
        return str(connected.getpeername()[0])
    except OSError:
        return ""

"""Healing's own messages, signed: strangers on the master can read them, but not speak for it.

A message type that is signed ends with `sent` and `signature` (shsa_msgs/Failure). The key is made
of the secret, the computer's present boot and the master: what was said in another boot, or to
another robot's healing, is worth nothing here. `sent` is on the monotonic clock, which all
processes of a computer share, and which neither jumps nor goes back: so a restarted sender is
always ahead of what it said before.
"""
import hmac
import io
import os
import time
from typing import Any, Callable, Mapping, Optional, Type
from urllib.parse import urlparse

import genpy
import rosgraph
import rosgraph.network
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros.graph import secret
from shsa_core.ros.graph.bounds import subscribe
from shsa_core.ros.graph.refusals import Refusals
from shsa_core.ros.graph.seal import SIGNATURE_B, TWICE, UNSIGNED, Gate, Seal

BOOT_ID = "/proc/sys/kernel/random/boot_id"
LARGEST_B = 1 << 25
"""A larger message is not read: its sender is cut off."""
NO_SIGNATURE = bytes(SIGNATURE_B)

Heard = Callable[[Any], None]


class Signing:
    """Signs and checks messages by the secret in a file (empty: the default one).

    `make`: it is made if it is not there. Raises ShsaError if it cannot be read.
    """

    def __init__(self, path: str = "", make: bool = True) -> None:
        self.path = os.path.abspath(path or secret.default_path())
        self.refusals = Refusals()
        told = f"{boot()} {master_place()}".encode()
        found = secret.obtain(self.path) if make else secret.read(self.path)
        self._key = hmac.digest(found, told, "sha256")

    def signed(self, topic: str, kind: Type[genpy.Message]) -> Any:
        """A message class like `kind`, whose messages are signed as they are serialized."""
        seal = Seal(self._key, rospy.resolve_name(topic))

        class Signed(kind):  # type: ignore[misc,valid-type]
            """A message that is signed."""

            def serialize(self, buff: io.BytesIO) -> None:
                """Write the message, and its signature at its end."""
                self.sent, self.signature = time.monotonic_ns(), NO_SIGNATURE
                start = buff.tell()
                super().serialize(buff)
                end = buff.tell() - SIGNATURE_B
                buff.seek(end)
                buff.write(seal.signature(buff.getvalue()[start:end]))

        return Signed

    def signer(self, topic: str, kind: Type[genpy.Message]) -> Callable[[Any], Any]:
        """What makes a message that is signed of one that is not."""
        signed = self.signed(topic, kind)
        return lambda message: signed(*(getattr(message, name) for name in kind.__slots__))

    def checked(
        self, topic: str, kind: Type[genpy.Message], unsigned: bool = False
    ) -> Type[genpy.Message]:
        """A message class like `kind` for one reader: of what is refused, nothing is decoded.

        Its messages have `refusal`; empty: none. `unsigned`: who signs nothing is believed too.
        """
        gate = Gate(Seal(self._key, rospy.resolve_name(topic)), time.monotonic_ns)

        class Checked(kind):  # type: ignore[misc,valid-type]
            """A message that is checked."""

            refusal = ""

            def deserialize(self, data: bytes) -> genpy.Message:
                """Read the message if its signature is right."""
                if not (unsigned and data.endswith(UNSIGNED)):
                    self.refusal = gate.refusal(data)
                return self if self.refusal else super().deserialize(data)

        return Checked

    def subscribe(self, topic: str, checked: Type[genpy.Message], heard: Heard) -> rospy.Subscriber:
        """Call `heard` with what is not refused; the rest is counted."""

        def received(message: Any) -> None:
            if message.refusal == TWICE:
                return
            if message.refusal:
                sender = message._connection_header.get("callerid", "")
                self.refusals.note(rospy.resolve_name(topic), sender, message.refusal)
            else:
                heard(message)

        return subscribe(topic, checked, received, LARGEST_B)


def boot() -> str:
    """The present boot of the computer. Raises ShsaError if it cannot be told."""
    try:
        with open(BOOT_ID, encoding="ascii") as file:
            return file.read().strip()
    except OSError as error:
        raise ShsaError(f"{BOOT_ID} cannot be read: {error.strerror}") from error


def master_place(environment: Optional[Mapping[str, str]] = None) -> str:
    """The master of a process, however it is spelled there; without an environment: of ours."""
    parts = urlparse(rosgraph.get_master_uri(environment))
    host = parts.hostname or ""
    if rosgraph.network.is_local_address(host):
        host = "localhost"
    return f"{host}:{parts.port}"

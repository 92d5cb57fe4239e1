"""Healing's own messages, signed: others may read them, but not speak for it; see trust/seal."""
import io
import os
import re
import secrets
import socket
import threading
import time
from functools import partial
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Type

import genpy
import rospy
from rospy.impl.masterslave import ROSHandler

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, address, ask_timed, master_api
from shsa_core.ros.rospy_patches.publishing import advertise
from shsa_core.ros.rospy_patches.subscribing import subscribe
from shsa_core.ros.trust import secret as secret_file
from shsa_core.ros.trust.places import master_seen, origin
from shsa_core.ros.workers import repeating
from shsa_core.text import shown
from shsa_core.trust import proof
from shsa_core.trust.boots import Boots, Met, NoAnswer
from shsa_core.trust.proof import Proof, WrongSecret
from shsa_core.trust.seal import BOOT_B, EARLY, FOREIGN, NO_SIGNATURE, SIGNATURE_B, TRAILER, TWICE
from shsa_core.trust.seal import UNPROVEN, UNSIGNED, Verifier, seal

LARGEST_B = 1 << 25
"""A larger message is not read: its sender is cut off."""
SENDERS = 100
"""So many are told apart."""
METHOD = "proveSecret"
NONCE_B = 16
NONCE = re.compile(f"[0-9a-f]{{{2 * NONCE_B}}}")


class Signing:
    """Signs and checks messages by the secret in a file, which it may `make`. Raises ShsaError."""

    def __init__(self, path: str = "", make: bool = True) -> None:
        self.path = os.path.abspath(path or secret_file.default_path())
        self.refusals = Refusals()
        self._secret = secret_file.obtain(self.path) if make else secret_file.read(self.path)
        self._boot = origin()
        self._challenge = partial(challenge, self._secret)
        self.boots = Boots(self._boot, self._challenge, time.monotonic_ns)
        self._lock = threading.Lock()
        self._measuring = repeating("clocks", settings.LOOK_S, self.boots.renew)
        serve(self._secret, self._boot)

    def signed(self, topic: str, kind: Type[genpy.Message]) -> Any:
        """Return a message class like `kind`, whose messages are signed as they are serialized."""
        secret, boot, name = self._secret, self._boot, rospy.resolve_name(topic)

        class Signed(kind):  # type: ignore[misc,valid-type]
            """A message that is signed."""

            def serialize(self, buff: io.BytesIO) -> None:
                """Write the message, and its signature at its end."""
                self.boot, self.sent, self.signature = boot, time.monotonic_ns(), NO_SIGNATURE
                start = buff.tell()
                super().serialize(buff)
                end = buff.tell() - SIGNATURE_B
                buff.seek(end)
                buff.write(seal(secret, boot, name, buff.getvalue()[start:end]))

        return Signed

    def signer(self, topic: str, kind: Type[genpy.Message]) -> Callable[[Any], Any]:
        """Return what makes a signed message of one that is not."""
        signed = self.signed(topic, kind)
        return lambda message: signed(*(getattr(message, name) for name in kind.__slots__))

    def checked(
        self, topic: str, kind: Type[genpy.Message], unsigned: bool = False
    ) -> Type[genpy.Message]:
        """Return a message class like `kind` for one reader: nothing refused is decoded.

        Its messages have `refusal`; empty: none. `unsigned`: what is not signed is believed too.
        """
        find = self.boots.find
        verifier = Verifier(self._secret, rospy.resolve_name(topic), find, time.monotonic_ns)

        class Checked(kind):  # type: ignore[misc,valid-type]
            """A message that is checked."""

            refusal = ""
            data = b""

            def deserialize(self, data: bytes) -> genpy.Message:
                """Read the message if its signature is right."""
                if unsigned and data.endswith(UNSIGNED):
                    return super().deserialize(data)
                self.refusal = verifier.refusal(data)
                if self.refusal:
                    self.data = data if self.refusal == UNPROVEN else b""
                    return self
                super().deserialize(data)
                self.boot, self.sent, _ = TRAILER.unpack_from(data, len(data) - TRAILER.size)
                return self

        return Checked

    def subscribe(
        self,
        topic: str,
        checked: Type[genpy.Message],
        heard: Callable[[Any], None],
        lost: Callable[[], None] = lambda: None,
    ) -> rospy.Subscriber:
        """Call `heard` with what is not refused; the rest is counted.

        What is heard has `sent_here`: when it was sent on our monotonic clock in ns, about.
        `lost` is called when a message was refused that may have been right.
        """

        def received(message: Any) -> None:
            sender = message._connection_header.get("callerid", "")
            if message.refusal == UNPROVEN:
                message = self._judge_again(message, sender)
            if not message.refusal:
                message.sent_here = self.boots.ours(message.boot, message.sent, sender)
                heard(message)
            elif message.refusal != TWICE:
                said = self.refusals.note(rospy.resolve_name(topic), sender, message.refusal)
                if said and message.refusal == FOREIGN:
                    self._suspect(sender)
                elif message.data or message.refusal == EARLY:
                    lost()

        return subscribe(topic, checked, received, LARGEST_B)

    def _judge_again(self, message: Any, sender: str) -> Any:
        end = len(message.data) - TRAILER.size
        message.refusal = self.boots.refusal(message.data[end : end + BOOT_B], sender)
        if message.refusal:
            return message
        with self._lock:
            if self._measuring.ident is None:  # one computer alone needs no such thread
                self._measuring.start()
        again = type(message)()
        again._connection_header = message._connection_header
        return again.deserialize(message.data)

    def _suspect(self, sender: str) -> None:
        """Say so if a sender has another secret: a person can mend that."""
        try:
            self._challenge(sender)
        except WrongSecret as error:
            rospy.logerr("%s: healing there is not believed. Ours is in %s.", error, self.path)
        except ShsaError:
            return  # it is no healer; that it was refused is said


def challenge(secret: bytes, node: str) -> Met:
    """Have a node prove that it holds the secret and uses our master, by a call of its own API.

    Raises NoAnswer; WrongSecret or ShsaError if what it answers is no proof.
    """
    asked = secrets.token_hex(NONCE_B)
    try:
        uri = str(master_api().lookupNode(node))
        where = shown(address(uri).host, 100)
        answer = ask_timed(uri, METHOD, asked)
    except FAILURES as error:
        raise NoAnswer("its sender does not prove where it is: no answer") from error
    try:
        found = proof.read(secret, asked, answer.value)
    except WrongSecret as error:
        raise WrongSecret(f"{shown(node, 100)} on {where}: {error}") from error
    ours = master_seen()
    if not found.master.is_same(ours):
        raise ShsaError(f"it is of another robot: its ROS master is {found.master}, not {ours}")
    since = time.monotonic_ns() - (answer.asked + answer.answered) // 2
    times = found.clock, found.wall - (time.time_ns() - since), answer.asked, answer.answered
    return Met(found.boot, shown(found.host, 100), where, *times)


def serve(secret: bytes, boot: bytes) -> None:
    """Have this process prove from now on that it holds the secret, as what signs with `boot`."""

    def prove(handler: Any, caller_id: object, asked: object) -> Tuple[int, str, Sequence[str]]:
        if not isinstance(asked, str) or not NONCE.fullmatch(asked):
            return -1, "a nonce is needed", []
        clocks = time.monotonic_ns(), time.time_ns()
        told = Proof(boot, socket.gethostname(), master_seen(), *clocks)
        return 1, "", proof.written(secret, asked, told)

    setattr(ROSHandler, METHOD, prove)


class SignedPublisher:
    """Publishes messages of one kind, each signed."""

    def __init__(
        self,
        signing: Signing,
        topic: str,
        kind: Type[genpy.Message],
        queue_size: int = settings.QUEUE,
        listener: Optional[rospy.SubscribeListener] = None,
    ) -> None:
        self.publisher = advertise(topic, kind, queue_size, listener)
        self.signed = signing.signer(topic, kind)

    def publish(self, message: genpy.Message) -> None:
        """Sign and publish a message."""
        self.publisher.publish(self.signed(message))


class Refusals:
    """Counts the refused messages by topic, by the name that their sender claims, and by reason."""

    def __init__(self) -> None:
        self._counts: Dict[Tuple[str, str, str], Tuple[int, float]] = {}  # and when it was said
        self._lock = threading.Lock()

    def note(self, topic: str, sender: str, why: str) -> bool:
        """Count a message, say so once in LONGEST_PAUSE_S; True: it was said now."""
        key = topic, shown(sender, 100), why
        now = time.monotonic()
        with self._lock:
            if key not in self._counts and len(self._counts) >= SENDERS:
                key = topic, "others", why
            count, said = self._counts.get(key, (0, -settings.LONGEST_PAUSE_S))
            count, again = count + 1, now >= said + settings.LONGEST_PAUSE_S
            self._counts[key] = count, now if again else said
        if not again:
            return False
        text = "Refused a message on %s from a sender named %s: %s (%d so far)."
        rospy.logwarn(text, topic, key[1], why, count)
        return True

    def counts(self) -> List[Tuple[str, int]]:
        """Return how many there were so far, each with topic, sender and reason."""
        with self._lock:
            return [(f"{t} from {s}: {why}", n) for (t, s, why), (n, _) in self._counts.items()]

"""Healing's own messages, signed: strangers on the master can read them, but not speak for it.

A message type that is signed ends with `boot`, `sent` and `signature` (shsa_msgs/Failure). The key
is made of the secret and that boot. It stands for the present boot of a computer and for the ROS
master: what was said in another boot, or to another robot's healing, is worth nothing here. `sent`
is on the monotonic clock, which all processes of a computer share, and which neither jumps nor goes
back: so a restarted sender is always ahead of what it said before. What another computer says is
believed once it has proved itself, and its clock was compared with ours (`computers`).
"""
import heapq
import hmac
import io
import os
import struct
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Set, Tuple, Type
from weakref import WeakKeyDictionary

import genpy
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.rospy_patches.subscribing import subscribe
from shsa_core.ros.trust import secret
from shsa_core.ros.trust.computers import Computer, Computers
from shsa_core.ros.trust.places import BOOT_B, origin
from shsa_core.ros.trust.computers import Challenger, WrongSecret, serve

LARGEST_B = 1 << 25
"""A larger message is not read: its sender is cut off."""
SENDERS = 100
"""So many are told apart."""
LONGEST_NAME = 100


class Signing:
    """Signs and checks messages by the secret in a file (empty: the default one).

    `make`: it is made if it is not there. Raises ShsaError if it cannot be read. `computers`: those
    that are believed.
    """

    def __init__(self, path: str = "", make: bool = True) -> None:
        self.path = os.path.abspath(path or secret.default_path())
        self.refusals = Refusals()
        self._secret = secret.obtain(self.path) if make else secret.read(self.path)
        self._boot = origin()
        self._challenger = Challenger(self._secret)
        self.computers = Computers(self._boot, self._challenger.ask)
        self._lock = threading.Lock()
        self._measuring: Optional[threading.Thread] = None
        self._met = threading.Event()
        serve(self._secret, self._boot)

    def signed(self, topic: str, kind: Type[genpy.Message]) -> Any:
        """Return a message class like `kind`, whose messages are signed as they are serialized."""
        boot, seal = self._boot, Seal(self._secret, self._boot, rospy.resolve_name(topic))

        class Signed(kind):  # type: ignore[misc,valid-type]
            """A message that is signed."""

            def serialize(self, buff: io.BytesIO) -> None:
                """Write the message, and its signature at its end."""
                self.boot, self.sent, self.signature = boot, time.monotonic_ns(), NO_SIGNATURE
                start = buff.tell()
                super().serialize(buff)
                end = buff.tell() - SIGNATURE_B
                buff.seek(end)
                buff.write(seal.signature(buff.getvalue()[start:end]))

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
        find = self.computers.find
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
        `lost` is called when a message was refused that may have been right: its sender did not
        answer, or two clocks could not be compared well enough.
        """

        def received(message: Any) -> None:
            sender = message._connection_header.get("callerid", "")
            if message.refusal == UNPROVEN:
                message = self._judge_again(message, sender)
            if not message.refusal:
                message.sent_here = self.computers.ours(message.boot, message.sent, sender)
                heard(message)
            elif message.refusal != TWICE:
                said = self.refusals.note(rospy.resolve_name(topic), sender, message.refusal)
                if said and message.refusal == FOREIGN:
                    self._suspect(sender)
                elif message.data or message.refusal == EARLY:
                    lost()

        return subscribe(topic, checked, received, LARGEST_B)

    def _judge_again(self, message: Any, sender: str) -> Any:
        """Judge a message whose computer is not known, once its sender was asked."""
        end = len(message.data) - TRAILER.size
        message.refusal = self.computers.refusal(message.data[end : end + BOOT_B], sender)
        if message.refusal:
            return message
        self._keep_measured()
        again = type(message)()
        again._connection_header = message._connection_header
        return again.deserialize(message.data)

    def _keep_measured(self) -> None:
        """Compare clocks from now on, in a thread that one computer alone does not need."""
        self._met.set()
        with self._lock:
            if self._measuring is None:
                self._measuring = threading.Thread(target=self._measure, name="clocks", daemon=True)
                self._measuring.start()

    def _measure(self) -> None:
        while not rospy.is_shutdown():
            self._met.wait(self.computers.renew())
            self._met.clear()

    def _suspect(self, sender: str) -> None:
        """Say so if a sender has another secret: a person can mend that."""
        try:
            self._challenger.ask(sender)
        except WrongSecret as error:
            rospy.logerr("%s: healing there is not believed. Ours is in %s.", error, self.path)
        except ShsaError:
            return  # it is no healer; that it was refused is said


class Refusals:
    """Counts the refused messages by topic, by the name that their sender claims, and by reason."""

    def __init__(self) -> None:
        self._counts: Dict[Tuple[str, str, str], Tuple[int, float]] = {}  # and when it was said
        self._lock = threading.Lock()

    def note(self, topic: str, sender: str, why: str) -> bool:
        """Count a message, say so once in LONGEST_PAUSE_S; True: it was said now."""
        key = topic, ascii(sender[:LONGEST_NAME])[1:-1], why
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


SIGNATURE_B = 32
NO_SIGNATURE = bytes(SIGNATURE_B)
TRAILER = struct.Struct(f"<{BOOT_B}sQ{SIGNATURE_B}s")
"""The last fields of a signed message: in which boot and when (ns) it was sent, and the signature.
"""
UNSIGNED = bytes(TRAILER.size)
WRONG = "its signature is wrong"
FOREIGN = f"{WRONG}: it is forged, or the secret of its computer is another than ours"
TWICE = "it came twice"
"""rospy may make two connections between the same two nodes for a moment: no reason to warn."""
UNPROVEN = "its computer has not proved itself"
REPEATED = "it was sent before, and is repeated"
EARLY = "it was sent before we listened, as far as two clocks can be compared"
FUTURE = "it is from the future"
AHEAD_NS = 1_000_000_000
AT_ONCE_NS = 1_000_000_000
REMEMBERED = 4096
"""So many signatures a reader knows again; what is older than the oldest is refused as well."""

Find = Callable[[bytes], Optional[Computer]]
"""The computer that has proved that a boot is its own."""


class Seal:
    """Signs the messages of one topic that are sent in one boot.

    What is signed: boot and topic, by way of the key, and every byte before the signature.
    """

    def __init__(self, secret: bytes, boot: bytes, topic: str) -> None:
        key = hmac.digest(secret, b"messages" + boot, "sha256")
        self._key = hmac.digest(key, topic.encode(), "sha256")

    def signature(self, data: bytes) -> bytes:
        """Return the signature of what stands before it in a message."""
        return hmac.digest(self._key, data, "sha256")

    def is_on(self, data: bytes) -> bool:
        """Return whether a message ends with its right signature."""
        return hmac.compare_digest(data[-SIGNATURE_B:], self.signature(data[:-SIGNATURE_B]))


class Verifier:
    """Tells one reader of a topic what to refuse. `clock`: ns, of this computer.

    Nothing that was sent before the reader began can be meant for it, and no message comes twice:
    a repetition of what healing said is refused. From any thread.
    """

    def __init__(self, secret: bytes, topic: str, find: Find, clock: Callable[[], int]) -> None:
        self._secret, self._topic, self._find, self._clock = secret, topic, find, clock
        self._began = clock()
        self._senders: "WeakKeyDictionary[Computer, _Sender]" = WeakKeyDictionary()
        self._lock = threading.Lock()

    def refusal(self, data: bytes) -> str:
        """Return why a message is refused; empty: it is not. UNPROVEN: ask its sender, then again.

        A stranger's message is never worth a question: its signature is wrong.
        """
        if data[-TRAILER.size :] == UNSIGNED or len(data) < TRAILER.size:
            return "it is not signed"
        boot, sent, signature = TRAILER.unpack_from(data, len(data) - TRAILER.size)
        computer = self._find(boot)
        sender = None if computer is None else self._sender(computer)
        if computer is None or sender is None:
            if not Seal(self._secret, boot, self._topic).is_on(data):
                return FOREIGN
            if computer is not None:
                computer.is_doubted = True
            return UNPROVEN
        if not sender.seal.is_on(data):
            return WRONG if computer.met is None else FOREIGN
        now = computer.latest(self._clock())
        if sent > now + AHEAD_NS:
            # Another clock may have stood, or ours; our own is right by definition.
            computer.is_doubted = computer.met is not None
            return UNPROVEN if computer.is_doubted else FUTURE
        with self._lock:
            return sender.refusal(sent, signature, now)

    def _sender(self, computer: Computer) -> Optional["_Sender"]:
        """Return its sender; None: its clock was not compared since we began."""
        with self._lock:
            sender = self._senders.get(computer)
            if sender is None and computer.was_compared(self._began):
                floor = computer.latest(max(self._began, computer.since))
                why = REPEATED if computer.met is None else EARLY
                sender = _Sender(Seal(self._secret, computer.boot, self._topic), floor, why)
                self._senders[computer] = sender
        return sender


class _Sender:
    """The memory that a reader has of one boot's messages."""

    def __init__(self, seal: Seal, floor: int, too_early: str) -> None:
        self.seal = seal
        self._floor, self._too_early = floor, too_early
        self._order: List[Tuple[int, bytes]] = []
        self._known: Set[bytes] = set()

    def refusal(self, sent: int, signature: bytes, now: int) -> str:
        """Return why a message of that time is refused; empty: it is not. `now`: on its clock."""
        if signature in self._known and sent > now - AT_ONCE_NS:
            return TWICE
        if signature in self._known:
            return REPEATED
        if sent <= self._floor:
            return self._too_early
        self._known.add(signature)
        heapq.heappush(self._order, (sent, signature))
        if len(self._order) > REMEMBERED:
            self._floor, oldest = heapq.heappop(self._order)
            self._known.remove(oldest)
        return ""

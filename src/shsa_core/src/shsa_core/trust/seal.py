"""Signatures of messages, and what a reader of a topic refuses by them.

A message that is signed ends with `boot`, `sent` and `signature` (shsa_msgs/Failure). The key is
made of the secret and that boot. It stands for the present boot of a computer and for the ROS
master: what was said in another boot, or to another robot's healing, is worth nothing here. `sent`
is on the monotonic clock, which all processes of a computer share, and which neither jumps nor goes
back: so a restarted sender is always ahead of what it said before. What another computer says is
believed once it has proved itself, and its clock was compared with ours (`boots`).
"""
import heapq
import hmac
import struct
import threading
from typing import Callable, List, Optional, Set, Tuple
from weakref import WeakKeyDictionary

from shsa_core.trust.boots import Boot

BOOT_B = 16
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

Find = Callable[[bytes], Optional[Boot]]
"""The computer that has proved that a boot is its own."""


def signature(secret: bytes, *words: bytes) -> bytes:
    """Return the signature of the last word, by a key that is made of the secret for the others."""
    for word in words:
        secret = hmac.digest(secret, word, "sha256")
    return secret


def seal(secret: bytes, boot: bytes, topic: str, data: bytes) -> bytes:
    """Return the signature after `data`, a message on a topic that is sent in one boot."""
    return signature(secret, b"messages" + boot, topic.encode(), data)


class Verifier:
    """Tells one reader of a topic what to refuse. `clock`: ns, of this computer.

    Nothing that was sent before the reader began can be meant for it, and no message comes twice:
    a repetition of what healing said is refused. From any thread.
    """

    def __init__(self, secret: bytes, topic: str, find: Find, clock: Callable[[], int]) -> None:
        self._secret, self._topic, self._find, self._clock = secret, topic, find, clock
        self._began = clock()
        self._senders: "WeakKeyDictionary[Boot, _Sender]" = WeakKeyDictionary()
        self._lock = threading.Lock()

    def refusal(self, data: bytes) -> str:
        """Return why a message is refused; empty: it is not. UNPROVEN: ask its sender, then again.

        A stranger's message is never worth a question: its signature is wrong.
        """
        if data[-TRAILER.size :] == UNSIGNED or len(data) < TRAILER.size:
            return "it is not signed"
        boot, sent, given = TRAILER.unpack_from(data, len(data) - TRAILER.size)
        computer = self._find(boot)
        right = seal(self._secret, boot, self._topic, data[:-SIGNATURE_B])
        if not hmac.compare_digest(given, right):
            return WRONG if computer is not None and computer.met is None else FOREIGN
        sender = None if computer is None else self._sender(computer)
        if computer is None or sender is None:
            if computer is not None:
                computer.is_doubted = True
            return UNPROVEN
        now = computer.latest(self._clock())
        if sent > now + AHEAD_NS:
            # Another clock may have stood, or ours; our own is right by definition.
            computer.is_doubted = computer.met is not None
            return UNPROVEN if computer.is_doubted else FUTURE
        with self._lock:
            return sender.refusal(sent, given, now)

    def _sender(self, computer: Boot) -> Optional["_Sender"]:
        """Return its sender; None: its clock was not compared since we began."""
        with self._lock:
            sender = self._senders.get(computer)
            if sender is None and computer.was_compared(self._began):
                floor = computer.latest(max(self._began, computer.since))
                why = REPEATED if computer.met is None else EARLY
                sender = self._senders[computer] = _Sender(floor, why)
        return sender


class _Sender:
    """The memory that a reader has of one boot's messages."""

    def __init__(self, floor: int, too_early: str) -> None:
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

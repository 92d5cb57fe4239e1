"""The signature of messages on one topic, and what a reader of them refuses."""
import heapq
import hmac
import struct
import threading
from typing import Callable, List, Set, Tuple

TRAILER = struct.Struct("<Q32s")
"""The last fields of a signed message: when it was sent (ns), and the signature."""
SIGNATURE_B = 32
UNSIGNED = bytes(TRAILER.size)
TWICE = "it came twice"
"""rospy may make two connections between the same two nodes for a moment: no reason to warn."""
AHEAD_NS = 1_000_000_000
AT_ONCE_NS = 1_000_000_000
REMEMBERED = 4096
"""So many signatures a reader knows again; what is older than the oldest is refused as well."""


class Seal:
    """Signs the messages of one topic.

    What is signed: the topic's name, by way of the key, and every byte before the signature.
    """

    def __init__(self, key: bytes, topic: str) -> None:
        self._key = hmac.digest(key, topic.encode(), "sha256")

    def signature(self, data: bytes) -> bytes:
        """The signature of what stands before it in a message."""
        return hmac.digest(self._key, data, "sha256")


class Gate:
    """Tells one reader of a topic what to refuse. `clock`: ns, the clock of those who send.

    Nothing that was sent before the reader began can be meant for it, and no message comes twice:
    whoever repeats what healing said is refused. From any thread.
    """

    def __init__(self, seal: Seal, clock: Callable[[], int]) -> None:
        self._seal, self._clock = seal, clock
        self._floor = clock()
        self._order: List[Tuple[int, bytes]] = []
        self._known: Set[bytes] = set()
        self._lock = threading.Lock()

    def refusal(self, data: bytes) -> str:
        """Why a message is refused; empty: it is not."""
        if data[-TRAILER.size :] == UNSIGNED or len(data) < TRAILER.size:
            return "it is not signed"
        sent, signature = TRAILER.unpack_from(data, len(data) - TRAILER.size)
        if not hmac.compare_digest(signature, self._seal.signature(data[:-SIGNATURE_B])):
            return "its signature is wrong"
        if sent > self._clock() + AHEAD_NS:
            return "it is from the future"
        with self._lock:
            if signature in self._known and sent > self._clock() - AT_ONCE_NS:
                return TWICE
            if signature in self._known or sent <= self._floor:
                return "it was sent before, and is repeated"
            self._known.add(signature)
            heapq.heappush(self._order, (sent, signature))
            if len(self._order) > REMEMBERED:
                self._floor, oldest = heapq.heappop(self._order)
                self._known.remove(oldest)
        return ""

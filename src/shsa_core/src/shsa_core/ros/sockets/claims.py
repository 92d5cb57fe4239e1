"""Connections of which the master has not said yet whose they are: what they say is put aside."""
from dataclasses import dataclass
from typing import Callable, Dict, Iterator, NamedTuple, Optional

from shsa_core.ros.sockets.identities import Identified, Identities
from shsa_core.ros.sockets.inbox import Inbox
from shsa_core.ros.sockets.stream import Connection

ASK_AGAIN_S = (0.5, 1.0, 2.0, 5.0, 10.0)
"""After these pauses the master is asked again who is at an address that it does not list."""
NOT_LISTED = "the master does not list this name at its address: it counts for nobody"


@dataclass
class _Claim:
    """`newest`: the last message so far.

    `ask`: when the master is asked again; None: it is asked now.
    """

    connection: Connection
    newest: Optional[bytes] = None
    tries: int = 0
    ask: Optional[float] = None


class Recognized(NamedTuple):
    """A connection is its `publisher`'s now. `newest`: the last message before that, if any."""

    connection: Connection
    newest: Optional[bytes] = None


class Claims:
    """Keeps a connection until its node is known.

    All methods are for the thread that reads `inbox`. `refused(topic, claim, why)` is called for
    who is not whom it calls itself.
    """

    def __init__(self, inbox: Inbox, refused: Callable[[str, str, str], None]) -> None:
        self._refused = refused
        self._identities = Identities(inbox)
        self._claims: Dict[int, _Claim] = {}

    def __contains__(self, descriptor: int) -> bool:
        return descriptor in self._claims

    def take(self, connection: Connection) -> Iterator[Recognized]:
        """A connection stands: it is known at once, or asked about."""
        uri = connection.transport.endpoint_id
        if self._identities.is_known(connection.publisher, uri):
            yield Recognized(connection)
        else:
            self._claims[connection.descriptor] = _Claim(connection)
            self._ask(connection)

    def put_aside(self, descriptor: int, data: bytes) -> None:
        """A message came before it was said whose it is."""
        self._claims[descriptor].newest = data

    def drop(self, descriptor: int) -> bool:
        """A connection has ended; whether it was one of those here."""
        return self._claims.pop(descriptor, None) is not None

    def forget(self, node: str, uri: str) -> None:
        """A node has gone: whoever comes to its address is asked about."""
        self._identities.forget(node, uri)

    def answered(self, item: Identified, now: float) -> Iterator[Recognized]:
        """The master has said whose a connection is, or has not."""
        for descriptor, claim in list(self._claims.items()):
            connection = claim.connection
            if connection.transport is not item.transport:
                continue
            if item.node:
                if item.node != connection.publisher:
                    why = f"it is {item.node}, by the master's word"
                    self._refused(item.topic, connection.publisher, why)
                    connection.publisher = item.node
                del self._claims[descriptor]
                yield Recognized(connection, claim.newest)
                continue
            if item.node is not None and claim.tries:  # at first it may be registering
                self._refused(item.topic, connection.publisher, NOT_LISTED)
            claim.ask = now + ASK_AGAIN_S[min(claim.tries, len(ASK_AGAIN_S) - 1)]
            claim.tries += 1

    def ask_again(self, now: float) -> None:
        """Ask about those whose pause is over."""
        for claim in self._claims.values():
            if claim.ask is not None and claim.ask <= now:
                claim.ask = None
                self._ask(claim.connection)

    def _ask(self, connection: Connection) -> None:
        self._identities.ask(connection.topic, connection.publisher, connection.transport)

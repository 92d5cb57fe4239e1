"""Tells a node that has gone from one that only closed a connection, and connects to it again.

A lost connection alone is no evidence: a rospy subscriber that is told of a publisher twice makes
two connections, and each end may drop another one; a publisher may drop a slow subscriber. What a
node that has gone cannot do is listen at its own address, or offer any topic: one that lives and
offers others has left this one. Who does not answer may be cut off, or wait for a processor: it is
asked again, ever more seldom, while it is listed; by workers alone, as its computer may be off.
"""
import socket
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from time import monotonic as _now
from typing import Callable, Dict, List, Optional, Tuple

from shsa_core.agenda import doubled
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, BadAnswer, address, family, topics
from shsa_core.ros.master.node_api import uri_of
from shsa_core.ros.rospy_patches.subscribing import HandedOver
from shsa_core.ros.workers import Workers

LEFT_PAUSES = 7
"""About a minute: whoever advertises a topic anew later is told of by the master."""


def refuses(at: str) -> bool:
    """Return whether nobody listens any more at a numeric address.

    A process that dies closes its connections first: who accepts has a moment to drop the call.
    """
    try:
        there = address(at)
    except BadAnswer:
        return False
    left = settings.REST_S
    end = _now() + left
    while left > 0.0:
        with socket.socket(family(there.host)) as caller:
            caller.settimeout(left)
            try:
                caller.connect(there)
                caller.settimeout(max(1e-6, end - _now()))
                caller.recv(1)
            except ConnectionRefusedError:
                return True
            except ConnectionResetError:
                pass
            except OSError:
                return False
        left = end - _now()
    return False


@dataclass
class Doubt:
    """Somebody who is not connected any more, and may be gone; or never was: `publisher` is empty.

    It was asked for another connection, and may not have answered yet (`waits`). `until`: when
    that took too long; so it did `pauses` times. `gone`: that is certain. `left`: it lives, and
    offers the topic no more, which is told once.
    """

    topic: str
    uri: str
    implementation: HandedOver
    publisher: str
    at: str
    until: float
    tries: int = 0
    waits: bool = False
    pauses: int = 0
    gone: bool = False
    left: bool = False


class Reconnection:
    """Keeps those who are in doubt, and asks them for connections.

    All methods are for one thread; they return who is gone, and once whoever may be. `tell` is
    called from others with a topic, and what is to be called for that.
    """

    def __init__(self, tell: Callable[[str, Callable[[], List[Doubt]]], None]) -> None:
        self._tell = tell
        self._workers = Workers("reconnect", settings.MOST_CALLS)
        self._listened: Dict[str, float] = {}
        self._doubts: Dict[Tuple[str, str], Doubt] = {}

    def lost(
        self, topic: str, uri: str, implementation: HandedOver, publisher: str = "", at: str = ""
    ) -> List[Doubt]:
        """Doubt whose connection has ended, or never stood: nobody else would ask for another."""
        doubt = Doubt(topic, uri, implementation, publisher, at, _now() + settings.CALL_S)
        if publisher or (topic, uri) not in self._doubts:
            self._doubts[topic, uri] = doubt
        return self._settle(self._doubts[topic, uri])

    def is_doubted(self, topic: str, uri: str) -> bool:
        """Return whether somebody is in doubt."""
        return (topic, uri) in self._doubts

    def _answered(self, doubt: Doubt, willing: Optional[bool], gone: bool = False) -> List[Doubt]:
        if self._doubts.get((doubt.topic, doubt.uri)) is not doubt:
            return []
        doubt.waits, doubt.gone = False, gone
        doubt.tries = doubt.tries if willing else settings.TRIES
        found, connects = self._settle(doubt), doubt.implementation.has_connection(doubt.uri)
        if found or connects or willing is not False or doubt.left or not doubt.publisher:
            return found
        doubt.left, doubt.until = True, _now() + settings.TURN_S
        return [doubt]

    def overdue(self) -> List[Doubt]:
        """Ask those again who took too long; who never stood is forgotten."""
        now, found = _now(), []
        for doubt in [each for each in self._doubts.values() if each.until <= now]:
            if not doubt.publisher or (doubt.left and doubt.pauses > LEFT_PAUSES):
                self._end(doubt)
                continue
            found += [] if doubt.pauses or doubt.left else [doubt]
            pause = doubled(settings.FIRST_PAUSE_S, doubt.pauses, settings.LONGEST_PAUSE_S)
            doubt.until, doubt.pauses, doubt.tries = now + pause, doubt.pauses + 1, 0
            found += self._settle(doubt)
        return found

    def connected(self, topic: str, publisher: str, uri: str) -> None:
        """Doubt no more who is connected, nor its predecessor."""
        for doubt in [each for each in self._doubts.values() if each.topic == topic]:
            if uri == doubt.uri or publisher == doubt.publisher:
                self._end(doubt)

    def forget(self, topic: str) -> None:
        """Doubt nobody on a topic that nobody reads any more."""
        self._doubts = {key: doubt for key, doubt in self._doubts.items() if key[0] != topic}

    def _end(self, doubt: Doubt) -> Doubt:
        return self._doubts.pop((doubt.topic, doubt.uri))

    def _settle(self, doubt: Doubt) -> List[Doubt]:
        if doubt.waits or doubt.implementation.has_connection(doubt.uri):
            return []
        doubt.gone = doubt.gone or (not doubt.pauses and self.is_gone(doubt.at))
        if doubt.gone:
            return [self._end(doubt)] if doubt.publisher else []
        if doubt.tries < settings.TRIES:
            doubt.waits, doubt.tries = True, doubt.tries + 1
            self._workers.put(partial(self._ask, doubt))
        return []

    def is_gone(self, at: str) -> bool:
        """Return whether a node refuses calls; one look does for all topics that it closes."""
        begin = _now() - settings.TURN_S
        self._listened = {each: looked for each, looked in self._listened.items() if looked > begin}
        if at in self._listened:
            return False
        gone = refuses(at)
        if not gone:
            self._listened[at] = _now()
        return gone

    def _ask(self, doubt: Doubt) -> None:
        willing: Optional[bool] = False
        gone = False
        try:
            with suppress(BadAnswer):
                willing = doubt.implementation.connect(doubt.uri)
            gone = not (willing or topics(doubt.uri))  # offering nothing, it is shutting down
        except FAILURES as error:  # who is cut off, or waits for a processor, closes nothing
            willing = None
            gone = not isinstance(error, OSError) or isinstance(error, ConnectionError)
            if not gone and doubt.pauses:  # who is listed no more would count for nobody
                with suppress(*FAILURES):
                    gone = uri_of(doubt.publisher) != doubt.uri
        finally:  # whatever a strange node answers, it is not willing
            self._tell(doubt.topic, lambda: self._answered(doubt, willing, gone))

"""Hears what healing tells: its signed tables, incidents, /diagnostics. Callbacks only enqueue."""
import time
from collections import deque
from functools import partial
from typing import Any, Callable, Deque, Dict, Iterable, Iterator, List

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from shsa_msgs import msg

from shsa_core.errors import ShsaError
from shsa_core.ros.messages.tables import TableSubscriber
from shsa_core.ros.rospy_patches.subscribing import subscribe
from shsa_core.ros.trust.signing import LARGEST_B, Signing
from shsa_core.ros.wire import names
from shsa_view import facts
from shsa_view.facts import presence
from shsa_view.ros import wire

LOOK_S = 0.2
"""Between two looks at who is connected."""
RECONFIGURATOR = "reconfigurator"

Make = Callable[[Any], facts.Fact]


class Listener:
    """Hears healing in this namespace; `take` gives the facts that have come since the last time.

    `secret`: the file by which what is heard is checked; empty: the default one. `hosts`: the
    computers that may have a monitor of their own. `make`: the secret is made if it is not there,
    as by all nodes of one launch.
    """

    def __init__(self, secret: str, hosts: Iterable[str], make: bool = False) -> None:
        self._facts: Deque[Callable[[], Iterable[facts.Fact]]] = deque()
        self._signing, self._trust = _signing(secret, make)
        self._diagnostics = wire.Diagnostics(rospy.get_namespace())
        self._heard: Dict[str, float] = {}
        self._tables: Dict[str, List[TableSubscriber]] = {}
        self._met: Dict[str, bool] = {}
        self._looked = 0.0
        for host in ("", *hosts):
            monitor, topic = names.monitor_of(host), names.told_by_monitor(host)[0]
            self._table(monitor, topic, msg.Health, partial(wire.health, monitor=host))
        self._table(RECONFIGURATOR, names.SOM_STATE, msg.SomState, wire.services)
        self._table(RECONFIGURATOR, names.SUBSTITUTIONS, msg.Substitutions, wire.substitutes)
        self._hear_incidents(partial(self._put, wire.incident))
        subscribe("/diagnostics", DiagnosticArray, self._diagnosed, LARGEST_B)

    def put(self, fact: facts.Fact) -> None:
        """Add a fact from elsewhere."""
        self._facts.append(lambda: (fact,))

    def take(self) -> Iterator[facts.Fact]:
        """Return what has come."""
        if time.monotonic() > self._looked + LOOK_S:
            self._looked = time.monotonic()
            yield from self._look()
        for _ in range(len(self._facts)):
            try:
                yield from self._facts.popleft()()
            except ShsaError as error:
                rospy.logwarn_throttle_identical(10.0, f"Not shown: {error}")

    def _table(self, sender: str, topic: str, kind: Any, make: Make) -> None:
        table = TableSubscriber(topic, kind, partial(self._put, make), self._signing)
        self._tables.setdefault(sender, []).append(table)

    def _hear_incidents(self, heard: Callable[[Any], None]) -> None:
        if self._signing is None:
            subscribe(names.INCIDENTS, msg.Incident, heard, LARGEST_B)
            return
        checked = self._signing.checked(names.INCIDENTS, msg.Incident)
        self._signing.subscribe(names.INCIDENTS, checked, heard)

    def _put(self, make: Make, message: Any) -> None:
        self._facts.append(lambda: (make(message),))

    def _diagnosed(self, message: DiagnosticArray) -> None:
        sender = self._diagnostics.sender(message)
        if sender in self._tables:
            self._heard[sender] = time.monotonic()
            self._facts.append(lambda: self._diagnostics.facts(message))

    def _look(self) -> Iterator[facts.Fact]:
        """Return who is there, and whether anything was refused."""
        for sender, tables in self._tables.items():
            connected = all(table.get_num_connections() for table in tables)
            met = self._met[sender] = self._met.get(sender, False) or connected
            if not connected:
                self._heard.pop(sender, None)
            elif sender not in self._heard:
                self._heard[sender] = time.monotonic()
            silent = time.monotonic() - self._heard[sender] if connected else None
            if met or "_" not in sender:
                state, text = presence(connected, met, silent)
                text = text and f"{sender}: {text}"
                yield facts.Healer(sender, state, text, connected)
        yield self._trusted()

    def _trusted(self) -> facts.TrustTold:
        if self._signing is None:
            return facts.TrustTold("unchecked", self._trust)
        counts = self._signing.refusals.counts()
        if not counts:
            return facts.TrustTold("checked")
        what = "; ".join(f"{what} ({count})" for what, count in counts[:5])
        return facts.TrustTold("refused", f"refused so far: {what}")


def _signing(secret: str, make: bool) -> Any:
    """Return the checker of signatures; None, and why, if there is no secret that we may read."""
    try:
        return Signing(secret, make), ""
    except ShsaError as error:
        text = f"Nothing that is shown can be checked: {error}"
        rospy.logwarn("%s", text)
        return None, text

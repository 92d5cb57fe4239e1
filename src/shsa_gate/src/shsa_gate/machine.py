"""The gate's core: judges each message before a consumer hears it, and who speaks to consumers."""
import math
from dataclasses import replace
from typing import Dict, List, Optional, Set

from shsa_core.derivations.settings import SAMPLE_S
from shsa_core.dispatch import Table, table
from shsa_core.model.checks import Finding, NotANumber, OutOfRange, RateHigh
from shsa_core.model.log import Level
from shsa_core.model.samples import RateSample
from shsa_core.model.service import Service
from shsa_core.model.substitution import CHANGEOVER_S, Substitution, row_key
from shsa_core.monitoring.events import Message, SubstitutionsChanged
from shsa_core.monitoring.evidence import Evidence
from shsa_core.watch import Watch
from shsa_gate import events, settings
from shsa_gate.doubt import Doubt
from shsa_gate.events import Arrived, Command, Event, Log, Pass


class _Original:
    """The service's node: whether it is believed, and how fast it may publish."""

    def __init__(self, service: Service) -> None:
        checks = service.checks
        # How many come is shaped, not judged: a good value stays one, however late it is.
        each = tuple(check for check in checks.each if check.sample is not RateSample)
        self.judged = replace(service, checks=replace(checks, each=each))
        self.begin_anew()
        limits = [float(check.limit) for check in checks.each if isinstance(check, RateHigh)]
        self._rate = limits[0] / service.period if service.period and limits else math.inf
        self._tokens, self._time = settings.BURST, -math.inf
        self.came = self.heard = -math.inf
        self.stamp = 0  # its last good message

    def begin_anew(self) -> None:
        """Hold nothing against it that another process did."""
        self.failure: Optional[Finding] = None
        self.evidence = Evidence(self.judged, learned={})

    def judge(self, arrived: Arrived) -> bool:
        """Tell if a message may be heard: it is good, and so were those before it."""
        seen = self.evidence.look(arrived.message, self.failure is not None)
        self.failure = self.evidence.verdict.add(seen) or self.failure
        if self.failure is not None and self.evidence.verdict.recovers(seen is None):
            self.failure = None
        return seen is None and self.failure is None

    def is_in_turn(self, time: float) -> bool:
        """Tell if a message is not one too many by the rate that the SOM allows."""
        passed, self._time = max(0.0, time - self._time), time
        if self._rate == math.inf:
            return True
        tokens = min(settings.BURST, self._tokens + passed * self._rate)
        self._tokens = tokens - 1.0 if tokens >= 1.0 else tokens
        return tokens >= 1.0


class Gate:
    """Chooses what consumers hear: the node's messages, or its substitute's in their place.

    A message of the node is heard at once if it is good, and if the table of substitutions does not
    say that a substitute stands in. A substitute's is heard while the node is not believed, where
    the node's is bad, and from when it is late until it is there again. `first`: the gate that this
    one stands by for, muted; empty: it is the first.
    """

    def __init__(self, service: Service, first: str = "", time: float = 0.0) -> None:
        self._service, self._first = service, first
        self._original = _Original(service)
        self._doubt = Doubt(service)
        self._rows: Dict[str, Substitution] = {}
        self._derived = Evidence(_values_alone(service))  # what substitutes say, without history
        self._substitutes: Set[str] = set()
        self._newest: Optional[Arrived] = None  # good message of a substitute
        self._muted, self._filling = bool(first), False
        self._last_out = time
        self._passed: Optional[Arrived] = None  # what went out last
        self._stamp = self._substitutes_stamp = 0  # the newest that went out
        self._watch = Watch()
        self._first_heard, self._may_miss = time, time + CHANGEOVER_S
        self._wanted = math.inf  # when it wanted to wake
        self._handlers: Table[List[Command]] = table(
            Event,
            {
                SubstitutionsChanged: self._substitutions_changed,
                Arrived: self._arrived,
                events.Disconnected: self._disconnected,
                events.Tick: self._tick,
            },
        )

    def service_of(self, publisher: str) -> Optional[Service]:
        """Return what judges a publisher: a substitute by its values alone; None: a stranger."""
        if publisher in self._substitutes:
            return self._derived.service
        return self._original.judged if publisher == self._service.node else None

    def handle(self, event: Event) -> List[Command]:
        """Return the commands that an event calls for."""
        self._watch.look(event.time, self._wanted)
        said = self._handlers[type(event)](event)
        self._wanted = self.next_deadline
        return said

    @property
    def next_deadline(self) -> float:
        """Return when the next events.Tick is wanted; inf: not before another event."""
        if self._service.period is None or (self._filling and not self._muted):
            return math.inf
        if not self._muted:
            return self._last_out + self._periods(settings.LATE)
        patience = max(self._periods(settings.OLD), settings.LEAST_PATIENCE_S)
        return max(self._may_miss, self._watch.when(self._first_heard, patience))

    def _periods(self, count: float) -> float:
        period = self._service.period
        return math.inf if period is None else count * period

    # The table of substitutions.

    def _substitutions_changed(self, event: SubstitutionsChanged) -> List[Command]:
        changed = [row_key(row) for row in event.rows]
        for key in list(self._rows) if event.whole else (*event.removed, *changed):
            self._rows.pop(key, None)
        mine = (row for row in event.rows if row.service == self._service.name and row.node)
        self._rows.update((row_key(row), row) for row in mine)
        self._substitutes = {row.node for row in self._rows.values()}
        if self._newest is not None and self._newest.message.publisher not in self._substitutes:
            self._newest = None
        return []

    @property
    def _stands_in(self) -> str:
        """Return the substitute of a node that is not believed; empty: the node is."""
        return next((row.node for row in self._rows.values() if row.publishing), "")

    # What comes.

    def _arrived(self, event: Arrived) -> List[Command]:
        publisher = event.message.publisher
        if event.message.topic != self._service.topic:
            return self._overheard(event.message)
        if publisher == self._service.node:
            return self._of_original(event)
        return self._of_substitute(event) if publisher in self._substitutes else []

    def _of_original(self, event: Arrived) -> List[Command]:
        original, before = self._original, self._original.failure
        good = original.judge(event)
        said = self._tell(before, original.failure)
        waited = event.message.waited > self._periods(settings.LATE)
        if self._stands_in or (waited and not event.newest):
            return said  # it tells of the past, and what follows it does not
        if not good:
            speaks = self._filling or before is not None
            return said if speaks else said + self._fill(event.time)
        if self._is_doubted(event):
            self._filling = True
            return said + self._fill(event.time)
        # Consumers may have heard a substitute's message of that time, or a later one.
        stamp = event.message.stamp
        ahead = self._substitutes_stamp - stamp
        replaced = stamp != 0 and 0 <= ahead < settings.CLOCK_SET_NS
        steady = event.time - original.came <= self._periods(settings.LATE)
        original.came = event.time
        if steady or not replaced:  # what one held that hung tells of the past
            original.heard, original.stamp = event.time, stamp
        if self._muted or replaced or not original.is_in_turn(event.time):
            return said
        self._filling = False
        return said + self._pass(event, event.time, stamp)

    def _is_doubted(self, event: Arrived) -> bool:
        """Tell if the newest value of a substitute contradicts a message of the node."""
        newest, period = self._newest, self._service.period
        judged = settings.JUDGED_LOOKS * SAMPLE_S
        old = judged if period is None else settings.OLD * period
        if newest is None:
            return False
        publisher = newest.message.publisher
        rows = (row for row in self._rows.values() if row.node == publisher)
        both = (self._original.evidence, event.message), (self._derived, newest.message)
        said, derived = (dict(zip(of.properties, message.values or ())) for of, message in both)
        doubted = self._doubt.holds(said, derived, rows, event.time)
        return doubted and event.time - newest.time <= old

    def _tell(self, before: Optional[Finding], after: Optional[Finding]) -> List[Command]:
        if (before is None) is (after is None) or self._muted:
            return []
        topic, node = self._service.heard, self._service.node
        if after is None:
            return [Log(Level.INFO, f"{topic}: {node} is good again, and is heard")]
        return [Log(Level.WARN, f"{topic}: {node} is not heard now: {after.detail}")]

    def _of_substitute(self, event: Arrived) -> List[Command]:
        """Keep a good value; pass it on while nobody better speaks."""
        message, speaker = event.message, self._stands_in
        bad = any(self._derived.findings(message, True))
        ahead = message.age is not None and message.age < -(self._service.period or 1.0)
        if bad or ahead or speaker not in ("", message.publisher):
            return []
        self._newest = event
        speaks = speaker or self._filling or self._original.failure is not None
        return self._fill(event.time) if speaks else []

    def _overheard(self, event: Message) -> List[Command]:
        """Be still: the gate that this one stands by for speaks."""
        if event.publisher != self._first:
            return []
        self._first_heard, self._may_miss = event.time, -math.inf
        self._last_out = max(self._last_out, event.time)
        self._stamp = max(self._stamp, event.stamp)
        was_muted, self._muted, self._filling = self._muted, True, False
        text = f"{self._service.heard}: {event.publisher} is back, it goes on"
        return [] if was_muted else [Log(Level.INFO, text)]

    def _disconnected(self, event: events.Disconnected) -> List[Command]:
        """Take over from a gate that is gone: nobody has to wait for its silence."""
        if event.publisher == self._service.node:
            self._original.begin_anew()
        gone = event.publisher == self._first and self._muted
        return self._take_over(event.time) if gone else []

    def _tick(self, event: events.Tick) -> List[Command]:
        """Fill in, or take over: whatever has come was heard before, so who is missed is late."""
        if event.time < self.next_deadline:
            return []
        if self._muted:
            return self._take_over(event.time)
        self._filling = True
        return self._fill(event.time)

    def _take_over(self, time: float) -> List[Command]:
        self._muted, self._filling = False, True
        text = f"{self._service.heard}: {self._first} is silent, this gate takes over"
        late = time - self._last_out > self._periods(settings.LATE)
        return [Log(Level.WARN, text), *(self._fill(time) if late else [])]

    # What goes out.

    def _fill(self, time: float) -> List[Command]:
        """Pass the substitute's newest value in the place of a message, if it is fresh."""
        newest, period = self._newest, self._service.period
        if newest is None or self._muted or time - newest.time > self._periods(settings.OLD):
            return []
        if period is not None and time - self._last_out < settings.APART * period:
            return []
        if period is None and (newest is self._passed or newest.time < self._last_out):
            return []  # consumers have heard it, or a later one of the node
        self._substitutes_stamp = stamp = self._stamp_of(newest, time)
        return self._pass(newest, time, stamp)

    def _stamp_of(self, newest: Arrived, time: float) -> int:
        """Return a stamp newer than any before, and no newer than that of the missing message."""
        # Else a node whose stamps are older than its substitute's could never return.
        original, period, wanted = self._original, self._service.period, newest.message.stamp
        if not wanted:
            return 0
        if original.stamp and period is not None:
            missing = math.floor((time - original.heard) / period + 0.25)
            wanted = min(wanted, original.stamp + round(missing * period * 1e9))
        return self._stamp + 1 if 0 <= self._stamp - wanted < settings.CLOCK_SET_NS else wanted

    def _pass(self, arrived: Arrived, time: float, stamp: int) -> List[Command]:
        self._last_out, self._stamp = time, stamp or self._stamp
        self._passed = arrived
        written = None if stamp == arrived.message.stamp else stamp
        return [Pass(arrived.data, arrived.message.publisher, written)]


def _values_alone(service: Service) -> Service:
    """Return a service of which single values are judged: a substitute owes nobody a history."""
    kinds = NotANumber, OutOfRange
    of_one = [tuple(c for c in each.checks if isinstance(c, kinds)) for each in service.provides]
    provides = tuple(replace(e, checks=checks) for e, checks in zip(service.provides, of_one))
    return replace(service, provides=provides, checks=replace(service.checks, each=()))

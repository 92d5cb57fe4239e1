"""The gate's core: judges each message before a consumer hears it, and who speaks to consumers."""
import math
from dataclasses import replace
from typing import Dict, List, Optional, Set

from shsa_core.dispatch import Table, table
from shsa_core.errors import ShsaError
from shsa_core.gating.events import (
    Arrived,
    Command,
    Event,
    GateLeft,
    Log,
    Overheard,
    Pass,
    Tick,
)
from shsa_core.gating.settings import Settings
from shsa_core.model.checks import NotANumber, OutOfRange, RateHigh, RateSample
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution, row_key
from shsa_core.monitoring.events import SubstitutionsChanged
from shsa_core.monitoring.evidence import Evidence, Finding
from shsa_core.watch import Watch

MOST_NAMED = 20
"""So many strangers are named."""
STRANGER_S = 1.0
"""Who publishes for so long without a row in the table of substitutions is a stranger."""
CLOCK_SET_NS = 10**9
"""A stamp that goes back by more is of a clock that was set."""
ALWAYS_JUDGED = (NotANumber, OutOfRange)
"""The checks that a substitute's values must pass: it owes nobody the original's history."""


class _Original:
    """What is known of the service's node: whether it is believed, and how fast it may publish."""

    def __init__(self, service: Service, burst: float) -> None:
        checks = service.checks
        # How many come is shaped, not judged: a good value stays one, however late it is.
        each = tuple(check for check in checks.each if check.sample is not RateSample)
        self.judged = replace(service, checks=replace(checks, each=each))
        self._evidence = Evidence(self.judged, learned={})
        self.failure: Optional[Finding] = None
        self._good_in_a_row = 0
        limits = [float(check.limit) for check in checks.each if isinstance(check, RateHigh)]
        shaped = service.period is not None and limits
        self._rate = limits[0] / service.period if shaped and service.period else math.inf
        self._burst = self._tokens = burst
        self._time = -math.inf

    def judge(self, arrived: Arrived) -> bool:
        """Whether a message may be heard: it is good, and so were those before it."""
        good, failure = self._evidence.weigh(arrived.message, self.failure is not None)
        self._good_in_a_row = self._good_in_a_row + 1 if good else 0
        if failure is not None:
            self.failure = self.failure or failure
        elif self.failure is not None and self._good_in_a_row >= self._evidence.recovery:
            self.failure = None
            self._evidence.clear()
        return good and self.failure is None

    def is_in_turn(self, time: float) -> bool:
        """Whether a message is not one too many by the rate that the SOM allows."""
        passed = max(0.0, time - self._time)
        self._time = time
        if self._rate < math.inf:
            self._tokens = min(self._burst, self._tokens + passed * self._rate)
            if self._tokens < 1.0:
                return False
            self._tokens -= 1.0
        return True


class _Newest:
    """The newest message of a substitute that passed its checks."""

    def __init__(self, arrived: Arrived) -> None:
        self.time, self.stamp, self.data = arrived.time, arrived.stamp, arrived.data
        self.publisher = arrived.message.publisher


class Gate:
    """Chooses what consumers hear: the node's messages, or its substitute's in their place.

    A message of the node is heard at once if it is good, and if the table of substitutions does not
    say that a substitute stands in. A substitute's is heard while the node is not believed, where
    the node's is bad, and from when it is late until it is there again.
    """

    def __init__(
        self, service: Service, settings: Settings = Settings(), time: float = 0.0
    ) -> None:
        self._settings = settings
        self._rows: Dict[str, Substitution] = {}
        self._substitutes: Set[str] = set()  # the nodes of the rows
        self._judges: Dict[str, Evidence] = {}
        self._strangers: Dict[str, float] = {}
        self._newest: Optional[_Newest] = None
        self._last_out = time
        self._watch, self._patience = Watch(), _patience(service, settings)
        self._first_heard = time  # the gate that this one stands by for
        self._may_miss = time + settings.start  # whom it has not heard yet
        self._wanted: Optional[float] = None  # when it wanted to wake
        self._stamp = self._substitutes_stamp = 0
        self._of_node = (-math.inf, 0)  # when its last message was heard, and its stamp
        self._filling = False
        self._muted = bool(settings.standby_for)
        self._said: List[Command] = []
        self._service = service
        self._original = _Original(service, settings.burst)
        self._values_alone = _values_alone(service)
        self._handlers: Table[List[Command]] = table(
            Event,
            {
                SubstitutionsChanged: self._substitutions_changed,
                Arrived: self._arrived,
                Overheard: self._overheard_other,
                GateLeft: self._gate_left,
                Tick: self._tick,
            },
        )

    @property
    def service(self) -> Service:
        """The service whose messages pass here."""
        return self._service

    def service_of(self, publisher: str) -> Service:
        """What a publisher's messages are judged by: of a substitute, its values alone."""
        return self._values_alone if publisher in self._substitutes else self._original.judged

    def handle(self, event: Event) -> List[Command]:
        """The commands that an event calls for."""
        self._watch.look(event.time, self._wanted)
        self._said = self._handlers[type(event)](event)
        self._wanted = self.next_deadline
        return self._said

    @property
    def next_deadline(self) -> float:
        """When the next Tick is wanted; inf: not before another event."""
        due = math.inf
        if self._muted:
            due = max(self._may_miss, self._watch.when(self._first_heard, self._patience))
        elif not self._filling:
            due = self._last_out + self._periods(self._settings.late)
        return due if self._service.period is not None else math.inf

    def validate(self) -> None:
        """Raises ShsaError if what must always hold after an event does not."""
        passed = [each for each in self._said if isinstance(each, Pass)]
        if self._muted and passed:
            raise ShsaError("a muted gate lets nothing pass")
        for each in passed:
            if each.publisher != self._service.node and each.publisher not in self._substitutes:
                raise ShsaError(f"{each.publisher} is neither the node nor a substitute")

    # What it is told.

    def _substitutions_changed(self, event: SubstitutionsChanged) -> List[Command]:
        changed = [row_key(row) for row in event.rows]
        for key in list(self._rows) if event.whole else (*event.removed, *changed):
            self._rows.pop(key, None)
        mine = (row for row in event.rows if row.service == self._service.name and row.node)
        self._rows.update((row_key(row), row) for row in mine)
        self._substitutes = {row.node for row in self._rows.values()}
        for node in [each for each in self._judges if each not in self._substitutes]:
            del self._judges[node]
        if self._newest is not None and self._newest.publisher not in self._substitutes:
            self._newest = None
        return []

    @property
    def _stands_in(self) -> str:
        """The substitute that stands in by the table: the node is not believed; empty: none."""
        return next((row.node for row in self._rows.values() if row.publishing), "")

    # What comes.

    def _arrived(self, event: Arrived) -> List[Command]:
        publisher = event.message.publisher
        if publisher == self._service.node:
            return self._of_original(event)
        if publisher in self._substitutes:
            return self._of_substitute(event)
        return self._of_stranger(publisher, event.time)

    def _of_stranger(self, publisher: str, time: float) -> List[Command]:
        """Nobody hears it; people are told once."""
        if publisher not in self._strangers and len(self._strangers) < MOST_NAMED:
            self._strangers[publisher] = time + STRANGER_S
        if time < self._strangers.get(publisher, math.inf):
            return []
        self._strangers[publisher] = math.inf
        who = "is neither its node nor a substitute of it, and is not heard"
        return [Log(f"{publisher} publishes on {self._service.topic}: it {who}")]

    def _of_original(self, event: Arrived) -> List[Command]:
        before = self._original.failure
        good = self._original.judge(event)
        said = self._tell(before, self._original.failure)
        waited = event.message.waited > self._periods(self._settings.late)
        if self._stands_in or (waited and not event.newest):
            return said  # it tells of the past, and what follows it does not
        if not good:
            speaks = self._filling or before is not None
            return said if speaks else said + self._fill(event.time)
        if self._muted or self._is_replaced(event.stamp):
            return said
        if not self._original.is_in_turn(event.time):
            return said
        self._filling = False
        self._of_node = event.time, event.stamp
        return said + self._pass(event.time, event.data, self._service.node, event.stamp)

    def _is_replaced(self, stamp: int) -> bool:
        """Whether consumers have heard a substitute's message of that time, or a later one."""
        return 0 <= self._substitutes_stamp - stamp < CLOCK_SET_NS if stamp else False

    def _tell(self, before: Optional[Finding], after: Optional[Finding]) -> List[Command]:
        if (before is None) is (after is None) or self._muted:
            return []
        topic, node = self._service.heard, self._service.node
        if after is None:
            return [Log(f"{topic}: {node} is good again, and is heard", bad=False)]
        return [Log(f"{topic}: {node} is not heard now: {after.detail}")]

    def _of_substitute(self, event: Arrived) -> List[Command]:
        """Keep a good value; pass it on while nobody better speaks."""
        message, period = event.message, self._service.period
        judge = self._judges.get(message.publisher)
        if judge is None:
            judge = self._judges[message.publisher] = Evidence(self._values_alone)
        ahead = message.age is not None and message.age < -(period or 1.0)
        if any(judge.findings(message, True)) or ahead:
            return []
        speaker = self._stands_in
        if speaker and message.publisher != speaker:
            return []
        self._newest = _Newest(event)
        speaks = bool(speaker) or self._filling or self._original.failure is not None
        return self._fill(event.time) if speaks else []

    def _overheard_other(self, event: Overheard) -> List[Command]:
        """The gate that this one stands by for speaks: be still."""
        if event.publisher != self._settings.standby_for:
            return []
        self._first_heard, self._may_miss = event.time, -math.inf
        self._last_out = max(self._last_out, event.time)
        self._stamp = max(self._stamp, event.stamp)
        self._filling = False
        if self._muted:
            return []
        self._muted = True
        return [Log(f"{self._service.heard}: {event.publisher} is back, it goes on", bad=False)]

    def _gate_left(self, event: GateLeft) -> List[Command]:
        """The gate that this one stands by for is gone: nobody has to wait for its silence."""
        if event.publisher != self._settings.standby_for or not self._muted:
            return []
        return self._take_over(event.time)

    def _tick(self, event: Tick) -> List[Command]:
        """Whatever has come was heard before: who is missed now is late."""
        if self._muted:
            missed = self._watch.has_passed(self._first_heard, self._patience)
            due = missed and event.time >= self._may_miss
            return self._take_over(event.time) if due else []
        if event.time < self.next_deadline:
            return []
        self._filling = True
        return self._fill(event.time)

    def _take_over(self, time: float) -> List[Command]:
        self._muted, self._filling = False, True
        first, topic = self._settings.standby_for, self._service.heard
        late = time - self._last_out > self._periods(self._settings.late)
        said: List[Command] = [Log(f"{topic}: {first} is silent, this gate takes over")]
        return said + self._fill(time) if late else said

    # What goes out.

    def _fill(self, time: float) -> List[Command]:
        """The substitute's newest value in the place of a message, if there is a fresh one."""
        newest = self._newest
        if newest is None or self._muted:
            return []
        if time - newest.time > self._periods(self._settings.fresh):
            return []
        if time - self._last_out < self._periods(self._settings.apart, else_=0.0):
            return []
        stamp = self._stamp_of(newest, time)
        self._substitutes_stamp = stamp
        return self._pass(time, newest.data, newest.publisher, stamp, stamp != newest.stamp)

    def _stamp_of(self, newest: _Newest, time: float) -> int:
        """Newer than any before it, and no newer than that of the message in whose place it is.

        Else a node whose stamps are older than its substitute's could never return.
        """
        heard, stamp = self._of_node
        if not newest.stamp:
            return 0
        wanted = newest.stamp
        if stamp and self._service.period is not None:
            periods = math.floor((time - heard) / self._service.period + 0.25)
            wanted = min(wanted, stamp + round(periods * self._service.period * 1e9))
        back = self._stamp - wanted
        return self._stamp + 1 if 0 <= back < CLOCK_SET_NS else wanted

    def _pass(
        self, time: float, data: bytes, publisher: str, stamp: int, written: bool = False
    ) -> List[Command]:
        self._last_out = time
        self._stamp = stamp or self._stamp
        return [Pass(data, publisher, stamp if written else None)]

    def _periods(self, count: float, else_: float = math.inf) -> float:
        period = self._service.period
        return else_ if period is None else count * period


def _patience(service: Service, settings: Settings) -> float:
    """Return the silence in s after which the first gate is missed."""
    if service.period is None:
        return math.inf
    return max(settings.silence * service.period, settings.least_silence)


def _values_alone(service: Service) -> Service:
    """A service of which nothing but single values is judged."""
    provides = tuple(
        replace(each, checks=tuple(c for c in each.checks if isinstance(c, ALWAYS_JUDGED)))
        for each in service.provides
    )
    return replace(service, provides=provides, checks=replace(service.checks, each=()))

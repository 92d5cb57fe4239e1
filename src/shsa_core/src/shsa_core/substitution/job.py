"""A program at work: when it is due, what it yielded last, and the stamp of that."""
import math
from collections import defaultdict, deque
from typing import DefaultDict, Deque, Dict, Iterable, List, Optional, Tuple

from shsa_core.codegen.program import compile_periodic
from shsa_core.errors import ShsaError
from shsa_core.model.field import is_angle
from shsa_core.model.log import Level
from shsa_core.model.substitution import Substitution
from shsa_core.substitution.events import Log
from shsa_core.substitution import settings


class Schedule:
    """Due once a period, first at once, until it is `done`; without a period, once it begins."""

    def __init__(self, period: Optional[float], now: float) -> None:
        self.period = math.inf if period is None else period
        self.due = now
        self._slot = now  # where `due` would be if nothing were ever late

    def begin(self, moment: float) -> None:
        """Be due at `moment`; what was due before and not done is no slot that was lost."""
        self.due = self._slot = moment

    def done(self, now: float) -> None:
        """Be due a period later, in phase, and never sooner than half a period from now.

        The phase is lost if this one was late by more than that and than MADE_UP_S.
        """
        late, half = now - self._slot, settings.SHORTEST_SHARE * self.period
        self._slot += self.period
        if late > max(half, settings.MADE_UP_S):
            self._slot = now + self.period
        self.due = max(self._slot, now + half)


class Job:
    """The program of one row of the table of substitutions.

    Raises ShsaError if the program is not valid, or if its outputs are not of one topic.
    """

    def __init__(self, row: Substitution, now: float) -> None:
        if len(row.topics) != 1:
            named = ", ".join(row.topics) or "none"
            raise ShsaError(f"its outputs must be fields of one topic, not of {named}")
        self._take(row)
        inputs = [(each.field, each.period) for each in row.inputs]
        program = compile_periodic(row.code, inputs, len(row.outputs), self.period, self._turned)
        self._program, self.timed = program, program.timed
        by_hand = row.publishing and not row.service  # then from 0, as documented
        sums = () if by_hand else zip(row.outputs, program.integrals)
        # Integrals from nobody knows where.
        self.unstarted = {signal.field for signal, sum_ in sums if sum_ is not None}
        self._begins: Dict[str, float] = {}  # where angles go on from
        self._shifts: Dict[str, float] = {}  # what is added to them since
        self._computed: Dict[str, Deque[Tuple[float, float]]] = {}  # lately, by time
        self.schedule = Schedule(self.period, now)
        self.latest: Optional[Tuple[float, ...]] = None  # what it yielded last, if anything
        self._stepped = self._rests_until = -math.inf
        # A derivative of a derivative waits for three samples: for so many evaluations.
        periods = [each.period or 0.0 for each in row.inputs] if self.timed else []
        pace = self.period or min(filter(None, periods), default=0.0)
        self._slack = math.ceil(3.0 * max(periods, default=0.0) / pace) if pace else 0
        self._misses, self._allowed = 0, settings.FIRST_MISSES + self._slack
        self._complained = False

    def _take(self, row: Substitution) -> None:
        self.inputs, self.outputs = row.inputs, row.outputs
        self.topic = row.topics[0]
        self.period = row.outputs[0].period
        self._words = words(row)

    def follow(self, row: Substitution, now: float) -> bool:
        """Return if a row has the same program: go on with its numbers, and what is remembered."""
        if words(row) != self._words:
            return False
        self._take(row)
        self._keep_phase(self.schedule, now)
        return True

    def succeed(self, old: "Job", computed: bool, now: float) -> None:
        """Go on where an old program of the same topic was; `computed`: its values were good."""
        if computed:
            self.start(zip((signal.field for signal in old.outputs), old.latest or ()))
        self._keep_phase(old.schedule, now)

    def _keep_phase(self, schedule: Schedule, now: float) -> None:
        self.schedule = Schedule(self.period, min(schedule.due, now + (self.period or math.inf)))

    @property
    def integrates(self) -> bool:
        """Return if it sums up, and so is as good as where it last started from."""
        return self._program.hidden or any(each is not None for each in self._program.integrals)

    @property
    def written(self) -> Tuple[Tuple[str, Optional[float]], ...]:
        """Return the fields of its outputs, each with its standard deviation; None: not known.

        No message says that it is certain: an error of 0 is written as one that is not known.
        """
        errors = (None if each.error is None else each.error.rms for each in self.outputs)
        return tuple((each.field, error or None) for each, error in zip(self.outputs, errors))

    def start(self, values: Iterable[Tuple[str, float]], at: Optional[float] = None) -> None:
        """Go on from the last good values: of integrals, and of angles, which may have any zero.

        An angle has the zero that makes it good `at` a time; None: now.
        """
        self._complained = False
        known = {field: value for field, value in values if math.isfinite(value)}
        for signal, sum_ in zip(self.outputs, self._program.integrals):
            if sum_ is not None and signal.field in known:
                sum_[0] = known[signal.field]
                self.unstarted.discard(signal.field)
                self.latest = None
            elif signal.field in known and is_angle(signal.field) and signal.error is None:
                then = self._computed.get(signal.field, ()) if at is not None else ()
                near = min(then, key=lambda each: abs(each[0] - (at or 0.0)), default=None)
                # A stamp of another clock says nothing of when that was.
                if near is None or abs(near[0] - (at or 0.0)) > (self.period or 0.0):
                    self._begins[signal.field] = known[signal.field]
                else:
                    self._shifts[signal.field] = known[signal.field] - near[1]
                self.latest = None

    def complain(self) -> List[Log]:
        """Say once that it integrates from nobody knows where."""
        if self._complained:
            return []
        self._complained = True
        said: List[Log] = []
        if self.unstarted:
            fields = ", ".join(sorted(self.unstarted))
            text = f"no last good message says where {fields} of {self.topic} was"
            said.append(Log(Level.ERROR, f"publishes nothing: {text}"))
        if self._program.hidden:
            text = f"{self.topic} is computed with an integral that has started at 0"
            said.append(Log(Level.WARN, text))
        return said

    def due(self, hurries: bool) -> float:
        """Return when to evaluate: once a period if it `hurries` or remembers, else seldom."""
        works = hurries or self._program.remembers or self._computed
        rests = -math.inf if works else self._rests_until
        return max(self.schedule.due, rests)

    def evaluate(self, values: Tuple[float, ...], now: float, at: Tuple[float, ...] = ()) -> bool:
        """Set `latest` to what the program yields of its inputs' `values`, which are of times `at`.

        Return if it has just been without a value for so long that another law may be better. Of
        two evaluations in close succession the second is left out: no derivative is taken of that.
        """
        self.schedule.done(now)
        self._rests_until = now + settings.REST_S
        soonest = self._stepped + settings.SHORTEST_SHARE * (self.period or 0.0)
        if self.latest is not None and now < soonest:
            return False
        self._stepped = now
        self.latest = self._calibrated(self._program.step(values, now, at))
        if self.latest is not None:
            self._misses, self._allowed = 0, settings.MISSES + self._slack
            return False
        self._misses += 1
        return self._misses == self._allowed

    def _calibrated(self, values: Optional[Tuple[float, ...]]) -> Optional[Tuple[float, ...]]:
        """Return what the program yields, by the gains and offsets of the row."""
        found = tuple(
            value if is_angle(signal.field) else signal.gain * value + signal.offset
            for signal, value in zip(self.outputs, values or ())
        )
        return found if values is not None and all(map(math.isfinite, found)) else None

    def _turned(self, number: int, value: float) -> float:
        """Return an angle by its offset; one of no known error goes on from the last good value."""
        signal = self.outputs[number]
        field = signal.field
        if not is_angle(field):
            return value
        if signal.error is not None or signal.gain != 1.0 or signal.offset:
            return signal.gain * value + signal.offset
        if math.isfinite(value):
            computed = self._computed.setdefault(field, deque(maxlen=settings.ANGLES_KEPT))
            computed.append((self._stepped, value))
            if field in self._begins:
                self._shifts[field] = self._begins.pop(field) - value
        return value + self._shifts.get(field, 0.0)


def words(row: Substitution) -> Tuple[object, ...]:
    """Return what makes the program of a row: code, fields and types, but no numbers."""
    ends = (*row.inputs, *row.outputs)
    named = ((each.topic, each.field, each.type, each.node) for each in ends)
    return (row.code, len(row.inputs), *named)


class Stamps:
    """The stamps of messages in ns of ROS time; 0: not known, or none.

    A stamp is that of the data that it stands on, never newer than now, and on one topic none is
    older than the one before, be that the original's. Where both cannot be, as when ROS time was
    set back, it is not newer than now.
    """

    def __init__(self) -> None:
        self._latest: DefaultDict[str, int] = defaultdict(int)  # by topic; 0: none yet
        self._ahead: Optional[int] = None  # ROS time less the clock of the events

    def clock(self, time: float, ros_time: int) -> None:
        """It is `ros_time` at the `time` of an event; 0: that is not known."""
        if ros_time:
            self._ahead = ros_time - _ns(time)

    def begin(self, topic: str, stamp: int) -> None:
        """The last good message of a topic had this stamp."""
        self._latest[topic] = max(stamp, self._latest[topic])

    def time(self, stamp: int) -> Optional[float]:
        """Return when a stamp was, by the clock of the events; None: not known."""
        return (stamp - self._ahead) / 1e9 if stamp and self._ahead is not None else None

    def of(self, topic: str, oldest: int, time: float) -> int:
        """Return the stamp of a message that is made now of inputs of which `oldest` is one's."""
        now = oldest if self._ahead is None else _ns(time) + self._ahead
        stamp = min(max(oldest or now, self._latest[topic]), now)
        self._latest[topic] = stamp
        return stamp


def _ns(time: float) -> int:
    return int(round(time * 1e9))

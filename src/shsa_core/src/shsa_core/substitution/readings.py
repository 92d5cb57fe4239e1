"""Keeps what a substitute computes from: the newest value of each signal, and how old it is."""
from math import inf
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

from shsa_core.backlog import Backlog
from shsa_core.language.memory import sample_times
from shsa_core.model.service import Signal
from shsa_core.substitution.events import InputArrived

Key = Tuple[str, str, str]
"""A topic, a field of its messages, and whose messages count; empty: anybody's."""
Reading = Tuple[float, float, int, str]
"""The time at which a value came, the value, the stamp of its message in ns, and its publisher."""


class Readings:
    """The newest value of each signal; what was listened to once stays so."""

    def __init__(self) -> None:
        self._readings: Dict[Key, Optional[Reading]] = {}
        self._allowed: Dict[str, float] = {}  # by topic: the shortest deadline
        self._backlogs: Dict[Tuple[str, str], Backlog] = {}  # by topic and publisher

    def listen(self, signals: Iterable[Signal]) -> List[Signal]:
        """Keep the values of `signals` from now on; return those of them that are new."""
        new: List[Signal] = []
        for signal in signals:
            topic, key = signal.topic, (signal.topic, signal.field, signal.node)
            self._allowed[topic] = min(self._allowed.get(topic, inf), signal.deadline or inf)
            if key not in self._readings:
                self._readings[key] = None
                new.append(signal)
        return new

    def take(self, event: InputArrived) -> None:
        """Keep the values of a message, unless it tells of the past."""
        time, topic, publisher = event.time, event.topic, event.publisher
        stamp = min(event.stamp or event.ros_time, event.ros_time)
        backlog = self._backlogs.setdefault((topic, publisher), Backlog())
        age = (event.ros_time - stamp) / 1e9
        if backlog.holds(time, age, self._allowed.get(topic, inf), event.waited):
            return
        for field, value in event.values:
            for key in ((topic, field, ""), (topic, field, publisher)):
                if key in self._readings:
                    self._readings[key] = time, value, stamp, publisher

    def values(self, signals: Sequence[Signal], now: float) -> Optional[Tuple[float, ...]]:
        """Return the values of `signals`; None if one has not come, or is past its deadline."""
        found = []
        for signal in signals:
            reading = self._reading(signal)
            if reading is None or now - reading[0] > (signal.deadline or inf):
                return None
            found.append(reading[1])
        return tuple(found)

    def times(self, signals: Sequence[Signal], now: float) -> Tuple[float, ...]:
        """Return when the values of `signals` came, in s; their stamps may be of any clock."""
        found = ((each.deadline, self._reading(each)) for each in signals)
        came = (read[0] if read and deadline is not None else None for deadline, read in found)
        return sample_times(came, now)

    def oldest(self, signals: Iterable[Signal]) -> int:
        """Return the oldest stamp of the values of `signals`, in ns; 0 if there are none.

        Where all hold until the next one it is the newest, else those do not count.
        """
        found = [(each.deadline, self._reading(each)) for each in signals]
        stamps = [read[2] for deadline, read in found if read and deadline is not None]
        return min(stamps) if stamps else max((read[2] for _, read in found if read), default=0)

    def sources(self, signals: Iterable[Signal]) -> Tuple[str, ...]:
        """Return who published the value of each of `signals`; empty: it has never come."""
        readings = map(self._reading, signals)
        return tuple("" if reading is None else reading[3] for reading in readings)

    def _reading(self, signal: Signal) -> Optional[Reading]:
        return self._readings[signal.topic, signal.field, signal.node]

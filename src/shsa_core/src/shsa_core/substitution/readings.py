"""Keeps what a substitute computes from: the newest value of each signal, and how old it is."""
from math import inf
from typing import Dict, Iterable, Optional, Sequence, Tuple

from shsa_core.model.service import Signal
from shsa_core.substitution.events import InputArrived

Key = Tuple[str, str]
"""A field of a topic's messages, and whose messages count; empty: anybody's."""
Reading = Tuple[float, float, int, str]
"""The time at which a value came, the value, the stamp of its message in ns, and its publisher."""


class _Stream:
    """The messages of one publisher of a topic. Times in s."""

    def __init__(self) -> None:
        self._came = inf
        self._usual = 0  # ns by which a message's stamp is older than the message here
        self._catches_up_until = -inf

    def is_backlog(self, time: float, age: int, allowed: float) -> bool:
        """Return if a message tells of the past, as after a cut of a link; `age` of its stamp, ns.

        So it is after a silence of more than `allowed` s, for no longer than that lasted: then it
        is the clock over there that was set.
        """
        silence, self._came = time - self._came, time
        if silence > allowed:
            self._catches_up_until = time + silence
        if time < self._catches_up_until and age - self._usual > 1e9 * allowed:
            return True
        self._usual, self._catches_up_until = age, -inf
        return False


class Readings:
    """The newest value of each signal; what was listened to once stays so."""

    def __init__(self) -> None:
        self._readings: Dict[str, Dict[Key, Optional[Reading]]] = {}
        self._allowed: Dict[str, float] = {}  # by topic: the shortest deadline
        self._streams: Dict[Tuple[str, str], _Stream] = {}

    def listen(self, signals: Iterable[Signal]) -> Tuple[Signal, ...]:
        """Keep the values of `signals` from now on; return those of them that are new."""
        new = []
        for signal in signals:
            readings = self._readings.setdefault(signal.topic, {})
            if signal.deadline is not None:
                known = self._allowed.get(signal.topic, inf)
                self._allowed[signal.topic] = min(known, signal.deadline)
            key = signal.field, signal.node
            if key not in readings:
                readings[key] = None
                new.append(signal)
        return tuple(new)

    def take(self, event: InputArrived) -> None:
        """Keep the values of a message, unless it tells of the past."""
        time, topic, publisher = event.time, event.topic, event.publisher
        stamp = min(event.stamp or event.ros_time, event.ros_time)
        stream = self._streams.setdefault((topic, publisher), _Stream())
        if stream.is_backlog(time, event.ros_time - stamp, self._allowed.get(topic, inf)):
            return
        readings = self._readings.get(topic, {})
        for field, value in event.values:
            for key in ((field, ""), (field, publisher)):
                if key in readings:
                    readings[key] = time, value, stamp, publisher

    def values(self, signals: Sequence[Signal], now: float) -> Optional[Tuple[float, ...]]:
        """Return the values of `signals`.

        None if one has never come or is older than its deadline: no value is invented.
        """
        found = []
        for signal in signals:
            reading = self._readings[signal.topic][signal.field, signal.node]
            if reading is None:
                return None
            time, value, _, _ = reading
            if signal.deadline is not None and now - time > signal.deadline:
                return None
            found.append(value)
        return tuple(found)

    def oldest(self, signals: Iterable[Signal]) -> int:
        """Return the oldest stamp among the values of `signals`, in ns; 0 if there are none."""
        readings = (self._readings[each.topic][each.field, each.node] for each in signals)
        return min((reading[2] for reading in readings if reading is not None), default=0)

    def sources(self, signals: Iterable[Signal]) -> Tuple[str, ...]:
        """Return who published the value of each of `signals`; empty: it has never come."""
        readings = (self._readings[each.topic][each.field, each.node] for each in signals)
        return tuple("" if reading is None else reading[3] for reading in readings)

    def listens(self, signal: Signal) -> bool:
        """Return if the values of a signal are kept."""
        return (signal.field, signal.node) in self._readings.get(signal.topic, {})

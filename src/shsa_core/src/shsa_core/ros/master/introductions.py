"""Which new publishers the master may have told nobody of.

The master tells subscribers with three threads and no timeout: while three subscribers hang, nobody
hears of a new publisher. So it is looked whether the others have connected to it. They are not told
beside the master, but after it: a rospy subscriber that is told twice at the same time connects
twice, and may end without any connection.
"""
from math import inf
from typing import Collection, Dict, FrozenSet, List, NamedTuple, Optional, Tuple

LOOKS_S = (0.3, 1.0, 3.0)
"""After a publisher has come; the master takes 0.1 s, and a connection a moment."""


class Publisher(NamedTuple):
    """A node at its URI publishes a topic."""

    topic: str
    node: str
    uri: str


class Introductions:
    """Publishers that came a moment ago, and when it is looked who is connected to them.

    `first`: the node of whoever asks; it may be the newest of all.
    """

    def __init__(self, first: str) -> None:
        self._first = first
        self._known: Optional[FrozenSet[Publisher]] = None
        self._looks: Dict[Publisher, List[float]] = {}

    @property
    def deadline(self) -> float:
        """When somebody is to be looked at, in s; infinite: nobody is."""
        return min((looks[0] for looks in self._looks.values()), default=inf)

    def heed(self, time: float, publishers: FrozenSet[Publisher]) -> None:
        """These publish now."""
        known = self._known
        if known is None:
            known = frozenset(each for each in publishers if each.node != self._first)
        self._known = publishers
        for publisher in [each for each in self._looks if each not in publishers]:
            del self._looks[publisher]
        for publisher in publishers - known:
            self._looks[publisher] = [time + pause for pause in LOOKS_S]

    def due(self, time: float) -> List[Publisher]:
        """Those to look at now."""
        found = [each for each, looks in self._looks.items() if looks[0] <= time]
        for publisher in found:
            rest = [look for look in self._looks[publisher] if look > time]
            if rest:
                self._looks[publisher] = rest
            else:
                del self._looks[publisher]
        return found


def unserved(
    subscribers: Collection[str], connected: Collection[str], publisher: str
) -> Tuple[str, ...]:
    """The subscribers that are not connected to a publisher; nobody connects to itself."""
    return tuple(sorted({*subscribers} - {*connected, publisher}))

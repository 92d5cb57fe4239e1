"""Finds the new publishers of which the master may have told nobody.

The master tells subscribers with three threads and no timeout: while three subscribers hang, nobody
hears of a new publisher. So it is looked whether the others have connected to it. They are not told
beside the master, but after it: a rospy subscriber that is told twice at the same time connects
twice, and may end without any connection.
"""
from math import inf
from typing import FrozenSet, List, NamedTuple, Optional, Set, Tuple

from shsa_core.ros import settings


class Publisher(NamedTuple):
    """A node at its URI publishes a topic."""

    topic: str
    node: str
    uri: str


class Introductions:
    """Publishers that came a moment ago, and when their connections are looked at.

    `first`: our own node; it may be the newest of all.
    """

    def __init__(self, first: str) -> None:
        self._first = first
        self._known: Optional[FrozenSet[Publisher]] = None
        self._looks: Set[Tuple[float, Publisher]] = set()

    @property
    def deadline(self) -> float:
        """Return when somebody is to be looked at, in s; infinite: nobody is."""
        return min((when for when, _ in self._looks), default=inf)

    def heed(self, time: float, publishers: FrozenSet[Publisher]) -> None:
        """Note the publishers of now."""
        known = self._known
        if known is None:
            known = frozenset(each for each in publishers if each.node != self._first)
        self._known = publishers
        self._looks = {look for look in self._looks if look[1] in publishers}
        pauses = settings.INTRODUCTION_LOOKS_S
        self._looks |= {(time + pause, each) for each in publishers - known for pause in pauses}

    def due(self, time: float) -> List[Publisher]:
        """Return those to look at now."""
        due = {look for look in self._looks if look[0] <= time}
        self._looks -= due
        return sorted({publisher for _, publisher in due})

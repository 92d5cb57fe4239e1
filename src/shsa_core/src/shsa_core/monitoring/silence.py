"""Whether a silence or a low rate is the publisher's own, or has another cause that passes.

There are three: the monitor itself was not scheduled; healing connects to the node, which then has
its threads to share; nodes that have nothing to do with each other fall silent together, as where
the computer is short of time. Each grants more time, all of them together one deadline at most:
the fixed one where a shorter one is learned, since of such causes nothing is.

Nodes that are all slow are slow for one reason too: none of them is blamed as long as that lasts.
Nor is one that is slow while healing connects to it.
"""
from math import inf
from typing import Dict, Iterable

from shsa_core.monitoring.events import Tick
from shsa_core.monitoring.publishers import Publisher

CONNECT_S = 0.1
"""A silence may come of a connection of healing's own that was made in it, or so long before."""
COMING_UP_S = 1.0
"""The same of a substitute that comes up: it has more to do after that, and so have others."""
REMEMBER_S = 600.0
TOGETHER_NODES = 3
"""So many nodes that are late at the same time are late for one reason."""
MISSED_PERIODS = 1.5
LEAST_GRANT_S = 1e-4
SLOW_PACE = 0.8
"""Of its rate: half way to what counts as too low where the SOM says nothing."""
LOOK_S = 0.1
"""Who is slow is looked at so often: every message of a slow node asks for it."""
EVERYBODY = ""


class Excuses:
    """What speaks for those who are silent. Times in s."""

    def __init__(self) -> None:
        self._connected: Dict[str, float] = {}
        self._slow, self._looked = 0, -inf

    def connected(self, node: str, time: float) -> None:
        """A connection to a node was made; `EVERYBODY`: a substitute came up, and may listen to
        all.
        """
        least = time - REMEMBER_S
        self._connected = {name: at for name, at in self._connected.items() if at > least}
        self._connected[node] = time

    def grant(self, publisher: Publisher, now: Tick, late_nodes: int) -> float:
        """The time in s from now on that a silent publisher is granted; 0: it is to blame.

        `late_nodes`: how many nodes are late, itself included.
        """
        allowed, silence = publisher.allowed, publisher.silence(now.time)
        most = 2 * publisher.patience
        if publisher.granted >= most - allowed:
            return 0.0
        if now.late >= allowed / 10:
            return min(now.late, allowed)
        if late_nodes >= TOGETHER_NODES or self.disturbed(publisher.name, now.time - silence):
            return max(0.0, most - silence)
        return 0.0

    def slows(self, publisher: Publisher, publishers: Iterable[Publisher], time: float) -> bool:
        """Whether a low rate has another cause: healing connects, or others are slow as well."""
        span = publisher.evidence.span if publisher.evidence is not None else 0.0
        return self.disturbed(publisher.name, time - span) or self._together(publishers, time)

    def _together(self, publishers: Iterable[Publisher], time: float) -> bool:
        """Whether so many nodes are slow that it is for one reason."""
        if not 0.0 <= time - self._looked < LOOK_S:
            self._looked = time
            self._slow = len({each.name for each in publishers if _is_slow(each)})
        return self._slow >= TOGETHER_NODES

    def disturbed(self, node: str, began: float) -> bool:
        """Whether healing connected since shortly before a silence, or a low rate, began."""
        last = (self._connected.get(name, -inf) for name in (node, EVERYBODY))
        return any(at + within >= began for at, within in zip(last, (CONNECT_S, COMING_UP_S)))


def late_nodes(publishers: Iterable[Publisher], time: float, longest: float = inf) -> int:
    """How many nodes have missed a message, and are silent for half their deadline or more.

    `longest`: s; who has a longer deadline counts as one who has this.
    """
    found = (p for p in publishers if is_silent_for(p, min(p.allowed, longest) / 2, time))
    return len({each.name for each in found})


def is_silent_for(publisher: Publisher, seconds: float, time: float) -> bool:
    """Whether a healthy publisher has missed a message, and is silent for so long at least."""
    service = publisher.service
    if publisher.last_message is None or service is None or service.period is None:
        return False
    least = max(seconds, MISSED_PERIODS * service.period)
    return publisher.is_healthy and publisher.silence(time) >= least


def _is_slow(publisher: Publisher) -> bool:
    pace = publisher.evidence.pace if publisher.evidence is not None else None
    return publisher.is_healthy and pace is not None and pace < SLOW_PACE

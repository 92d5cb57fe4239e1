"""Asks a node about its connections: how much it has sent on each, and to whom.

Asked on the node's own computer, this tells a node that is silent from one whose link is bad.
"""
from typing import Any, Dict, FrozenSet, NamedTuple, Optional, Tuple, Union

import rospy

from shsa_core.ros.master.node_api import FAILURES, Answer, ask, bus_stats, master_api

COUNTER = 2**32
"""roscpp counts in 32 bits."""


class Sent(NamedTuple):
    """Counters of a node on a topic: bytes published, messages by connection; at a time in ns."""

    data: int
    messages: Dict[int, int]
    at: int


def sent(answer: Answer, topic: str) -> Optional[Sent]:
    """Read what a node has sent on a topic from its answer to getBusStats; None: it is nonsense.

    A topic is [name, bytes, connections] in rospy, without the bytes in roscpp; a connection is
    [number, bytes, messages, connected], or [number, bytes, bytes of data, messages, 0].
    """
    try:
        row = next(each for each in answer.value[0] if each[0] == topic)
        messages = {int(each[0]): int(each[-2]) for each in row[-1] if len(each) in (4, 5)}
        return Sent(int(row[1]) if len(row) == 3 else 0, messages, answer.answered)
    except (StopIteration, LookupError, TypeError, ValueError):
        return None


def rate(uri: str, topic: str, seconds: float) -> Optional[float]:
    """Return the messages/s that a node sends to its best-served subscriber; 0: no answer.

    None: it cannot be told, as nobody is connected to it. Takes `seconds` and two calls.
    """
    first = _look(uri, topic)
    rospy.rostime.wallsleep(seconds)
    second = _look(uri, topic)
    if isinstance(first, OSError) and isinstance(second, OSError):
        return 0.0  # it hangs: it was asked where it runs
    if isinstance(first, Sent) and isinstance(second, Sent):
        return between(first, second)
    return None


def between(first: Sent, second: Sent) -> Optional[float]:
    """Return the messages/s from one look to the next; None: nobody is connected to get any."""
    numbers = first.messages.keys() & second.messages.keys()
    most = max(((second.messages[n] - first.messages[n]) % COUNTER for n in numbers), default=None)
    if most is None or (most == 0 and second.data != first.data):
        return None  # in the latter case all connections are held up, and it publishes
    return 1e9 * most / (second.at - first.at)


def _look(uri: str, topic: str) -> Union[Sent, OSError, None]:
    try:
        return sent(bus_stats(uri), topic)
    except OSError as error:
        return error
    except FAILURES:
        return None


class Originals:
    """Looks at the nodes that a substitute stands in for; for one thread."""

    def __init__(self) -> None:
        self._seen: Dict[str, Tuple[str, Dict[Any, str]]] = {}  # their addresses, and their ends

    def served_consumers(self, topic: str, original: str) -> Optional[FrozenSet[str]]:
        """Return the consumers to which the node `original` has published on a topic already.

        None if it does not answer, or not as nodes do. Messages of a node wait while it answers who
        its consumers are: it is asked that only where it is not known.
        """
        seen = self._seen.pop(original, None)  # else the master is asked again
        try:
            uri, ends = seen or (master_api().lookupNode(original), {})
            served = _served(topic, uri)
            if not served <= ends.keys():
                ends = connected(topic, uri)
            consumers = frozenset(ends[each] for each in served if each in ends)
        except (*FAILURES, LookupError, TypeError):
            return None
        self._seen[original] = uri, ends
        return consumers


def _served(topic: str, uri: str) -> FrozenSet[Any]:
    """Return the numbers of the connections on which something was sent. Raises as `connected`."""
    rows = [row for entry in ask(uri, "getBusStats")[0] if entry[0] == topic for row in entry[-1]]
    return frozenset(row[0] for row in rows if row[2] > 0)


def connected(topic: str, uri: str) -> Dict[Any, str]:
    """Return who is at the other end of a publisher's connections, by number.

    Raises one of FAILURES, LookupError or TypeError.
    """
    info = ask(uri, "getBusInfo")
    return {row[0]: str(row[1]) for row in info if row[2] == "o" and row[4] == topic}

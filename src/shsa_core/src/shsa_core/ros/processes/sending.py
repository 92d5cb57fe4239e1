"""What a node sends, by its own word: the counters of its connections, looked at twice.

Asked on the node's own computer, this tells a node that is silent from one whose link is bad.
"""
from typing import Dict, NamedTuple, Optional, Union

import rospy

from shsa_core.ros.master.node_api import FAILURES, Answer, bus_stats

Counters = Dict[int, int]
COUNTER = 2**32
"""roscpp counts in 32 bits."""


class Sent(NamedTuple):
    """What a node has sent on a topic so far: bytes published, messages by connection; when, ns."""

    data: int
    messages: Counters
    at: int


def rate(uri: str, topic: str, seconds: float) -> Optional[float]:
    """How many messages/s the node at `uri` sends on a topic to whom it sends most; 0: no answer.

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
    """The messages/s from one look to the next; None: nobody is connected who could get any."""
    numbers = first.messages.keys() & second.messages.keys()
    most = max(((second.messages[n] - first.messages[n]) % COUNTER for n in numbers), default=None)
    if most is None or (most == 0 and second.data != first.data):
        return None  # in the latter case all connections are held up, and it publishes
    return 1e9 * most / (second.at - first.at)


def sent(answer: Answer, topic: str) -> Optional[Sent]:
    """What a node has sent on a topic, of its answer to getBusStats; None: it makes no sense.

    A topic is [name, bytes, connections] in rospy, without the bytes in roscpp; a connection is
    [number, bytes, messages, connected], or [number, bytes, bytes of data, messages, 0].
    """
    try:
        row = next(each for each in answer.value[0] if each[0] == topic)
        messages = {int(each[0]): int(each[-2]) for each in row[-1] if len(each) in (4, 5)}
        return Sent(int(row[1]) if len(row) == 3 else 0, messages, answer.answered)
    except (StopIteration, LookupError, TypeError, ValueError):
        return None


def _look(uri: str, topic: str) -> Union[Sent, OSError, None]:
    try:
        return sent(bus_stats(uri), topic)
    except OSError as error:
        return error
    except FAILURES:
        return None

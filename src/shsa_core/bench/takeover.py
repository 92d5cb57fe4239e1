"""One failure and its repair, step by step."""
from typing import List, NamedTuple, Tuple

from shsa_msgs.msg import Incident

from graph import uri_of
from robot import NODE, Consumer, Consumers
from shsa_core.ros.graph import clock

STEPS = ("waited", "detect", "decide", "start", "kill", "connect", "first")
NAN = float("nan")


class Takeover(NamedTuple):
    """Times in ms; the steps add up to the outage at the rospy consumer.

    waited: from the last good message to the failure; it had to come anyway. detect: until the
    monitor saw the failure. decide: until the reconfigurator had its substitute. start: until the
    substitute was set to work. kill: until the faulty node was gone, where that must be waited for.
    connect: until the rospy consumer knew it; a hot one it knows. first: until its first good
    message from the substitute. `bad`: messages out of range that a consumer heard; `late`:
    messages of the faulty node after the substitute's first.
    """

    rospy_ms: float
    roscpp_ms: float
    waited_ms: float = NAN
    detect_ms: float = NAN
    decide_ms: float = NAN
    start_ms: float = NAN
    kill_ms: float = NAN
    connect_ms: float = NAN
    first_ms: float = NAN
    rospy_bad: int = 0
    roscpp_bad: int = 0
    late: int = 0
    substitute: str = ""

    def in_words(self) -> List[str]:
        """A row of a CSV file."""
        return [f"{each:.3f}" if isinstance(each, float) else str(each) for each in self]


def healed(consumers: Consumers, failed_at: float, incident: Incident) -> Takeover:
    """The takeover that an incident tells of, after a failure at `failed_at` (monotonic, s)."""
    node = incident.substitute
    edges = [_edges(consumer, node, failed_at) for consumer in consumers]
    last, first = edges[0]
    moments = [last, failed_at]
    for stamp in (incident.detected, incident.found, incident.spawned):
        moments.append(clock.from_stamp(stamp) or 0.0)
    # A node whose connection is lost publishes no more: nobody waits until it is gone.
    moments.append(
        0.0 if incident.kind == "node_gone" else clock.from_stamp(incident.killed) or 0.0
    )
    moments += [consumers.rospy.contacts.get(uri_of(node), 0.0), first]
    steps: List[float] = []
    for number, moment in enumerate(moments[1:], 1):
        moments[number] = min(first, max(moment, moments[number - 1]))
        steps.append(1e3 * (moments[number] - moments[number - 1]))
    bad = [sum(not m.good for m in consumer.since(failed_at)) for consumer in consumers]
    late = sum(m.node == NODE for m in consumers.rospy.since(first))
    outages = [1e3 * (after - before) for before, after in edges]
    return Takeover(
        outages[0],
        outages[1],
        **dict(zip((f"{step}_ms" for step in STEPS), steps)),  # type: ignore[arg-type]
        rospy_bad=bad[0],
        roscpp_bad=bad[1],
        late=late,
        substitute=node,
    )


def gap(consumer: Consumer, failed_at: float) -> float:
    """The longest pause in ms since the last message before a failure."""
    moments = [consumer.until(failed_at).at, *(m.at for m in consumer.since(failed_at))]
    return 1e3 * max(b - a for a, b in zip(moments, moments[1:]))


def _edges(consumer: Consumer, node: str, failed_at: float) -> Tuple[float, float]:
    """When the last good message came before `node` published, and its first good one."""
    first = next(m.at for m in consumer.since(failed_at) if m.node == node and m.good)
    return max(m.at for m in list(consumer.messages) if m.at < first and m.good), first

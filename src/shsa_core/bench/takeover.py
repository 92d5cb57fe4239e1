"""One failure and its repair, step by step."""
from typing import Any, Dict, List, Mapping, NamedTuple, Sequence, Tuple, get_type_hints

from shsa_msgs.msg import Incident

from graph import uri_of
from robot import NODE, Consumer, Consumers
from shsa_testing.healing import moment_of

STEPS = ("waited", "bridge", "detect", "decide", "start", "kill", "connect", "first")
NAN, NEVER = float("nan"), float("inf")
CALM_S = 0.5
"""So long a topic must be as it was for a failure to be over."""
CALM_PERIODS = 2.0
"""No pause is longer on a topic that is as it was."""
LEAST_PAUSE_S = 0.02
"""Nor is a shorter one any news: a consumer in Python pauses for as long."""


class Takeover(NamedTuple):
    """Times in ms; the steps add up to the outage at the rospy consumer.

    rospy, roscpp: the longest pause between two good messages, from the last one before the failure
    until it is over; inf: none came any more. over: from the failure until the last pause of more
    than two periods at either consumer; inf: there were such as long as one waited.

    waited: from the last good message to the failure; it had to come anyway. bridge: until the
    substitute filled in before anybody told it; then all later steps are none. detect: until the
    monitor saw the failure. decide: until the reconfigurator had its substitute. start: until the
    substitute was set to work. kill: until the faulty node was gone, where that must be waited for.
    connect: until the rospy consumer knew it; a hot one it knows. first: until its first good
    message from the substitute. `bad`: messages out of range that a consumer heard; `late`:
    messages of the faulty node after the substitute was told to publish and was heard.
    """

    rospy_ms: float
    roscpp_ms: float
    over_ms: float = NAN
    waited_ms: float = NAN
    bridge_ms: float = NAN
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

    @property
    def silence_ms(self) -> float:
        """The time from the last good message at the rospy consumer to the substitute's first."""
        return float(sum(getattr(self, f"{step}_ms") for step in STEPS))

    def in_words(self) -> List[str]:
        """Return a row of a CSV file."""
        return [f"{each:.3f}" if isinstance(each, float) else str(each) for each in self]


def from_words(words: Mapping[str, str]) -> Takeover:
    """Return a takeover by a row of a CSV file.

    Raises KeyError if a column is missing, ValueError if one is no number.
    """
    return Takeover(**{name: kind(words[name]) for name, kind in get_type_hints(Takeover).items()})


class Watched(NamedTuple):
    """A failure, as a consumer heard it; s."""

    outage: float
    over: float


def watched(good: Sequence[float], failed_at: float, until: float, period: float) -> Watched:
    """Return the longest pause and when all was over, as Takeover has them.

    `good`: when good messages came; looked at `until`. Raises AssertionError if none came before
    `failed_at`.
    """
    before = [at for at in good if at <= failed_at]
    assert before, "nothing good was heard before the failure"
    moments = [max(before), *(at for at in good if failed_at < at <= until)]
    if until - moments[-1] > CALM_S:
        return Watched(NEVER, NEVER)
    pauses = [(after - before, after) for before, after in zip(moments, moments[1:])]
    outage = max((pause for pause, _ in pauses), default=0.0)
    longest = max(CALM_PERIODS * period, LEAST_PAUSE_S)
    over = max((after for pause, after in pauses if pause > longest), default=failed_at)
    calm = until - over >= CALM_S and until - moments[-1] <= longest
    return Watched(outage, over - failed_at if calm else NEVER)


def measured(consumers: Consumers, failed_at: float, until: float, period: float) -> Takeover:
    """Return what both consumers heard of a failure, without its steps."""
    rospy, roscpp = (
        watched([m.at for m in list(each.messages) if m.good], failed_at, until, period)
        for each in consumers
    )
    bad = [sum(not m.good for m in each.since(failed_at)) for each in consumers]
    over = max(rospy.over, roscpp.over)
    return Takeover(
        1e3 * rospy.outage,
        1e3 * roscpp.outage,
        1e3 * over,
        rospy_bad=bad[0],
        roscpp_bad=bad[1],
    )


def with_steps(
    takeover: Takeover, consumers: Consumers, failed_at: float, incident: Incident
) -> Takeover:
    """Return the same with the steps that an incident tells of, after a failure at once."""
    node = incident.substitute
    last, first = _edges(consumers.rospy, node, failed_at)
    detected = moment_of(incident.detected)
    moments = [last, failed_at, first if first < detected else 0.0, detected]
    moments += [moment_of(stamp) for stamp in (incident.found, incident.spawned)]
    # A node whose connection is lost publishes no more: nobody waits until it is gone.
    moments.append(0.0 if incident.kind == "node_gone" else moment_of(incident.killed))
    moments += [consumers.rospy.contacts.get(uri_of(node), 0.0), first]
    steps: List[float] = []
    for number, moment in enumerate(moments[1:], 1):
        moments[number] = min(first, max(moment, moments[number - 1]))
        steps.append(1e3 * (moments[number] - moments[number - 1]))
    named: Dict[str, Any] = {f"{step}_ms": value for step, value in zip(STEPS, steps)}
    return takeover._replace(**named)


def with_substitute(
    takeover: Takeover, consumers: Consumers, failed_at: float, incident: Incident
) -> Takeover:
    """Return the same with what an incident tells of the substitute."""
    _, first = _edges(consumers.rospy, incident.substitute, failed_at)
    told = max(first, moment_of(incident.spawned))
    late = sum(m.node == NODE for m in consumers.rospy.since(told))
    return takeover._replace(late=late, substitute=incident.substitute)


def _edges(consumer: Consumer, node: str, failed_at: float) -> Tuple[float, float]:
    """Return the times of the last good message before `node`'s, and of its first good one."""
    first = next(m.at for m in consumer.since(failed_at) if m.node == node and m.good)
    return max(m.at for m in list(consumer.messages) if m.at < first and m.good), first

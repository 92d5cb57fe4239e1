"""Invariants after every step of chaos, judged by what an independent observer has seen."""
from dataclasses import dataclass, field
from typing import Dict, FrozenSet, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

Heard = Sequence[Tuple[float, str]]
"""Each message of a topic: its time in s, and its publisher."""

SANDWICH_PERIODS = 2.0
SERVED_S = 1.0
"""So long a topic must have had one voice to be quiet again."""
REST = ("ended", "kept", "unhealed", "safe")
"""States of an incident in which nothing more is done."""


@dataclass(frozen=True)
class Limits:
    """The most that a healer may grow from the beginning on."""

    memory_bytes: int = 64 * 2**20
    descriptors: int = 100
    threads: int = 60


@dataclass(frozen=True)
class Usage:
    """The resources that a process uses."""

    memory_bytes: int
    descriptors: int
    threads: int


@dataclass(frozen=True)
class Topic:
    """A topic that is watched: its nodes by the SOM, its deadline and period, s."""

    name: str
    nodes: FrozenSet[str]
    period: float
    deadline: float
    needed: bool


@dataclass(frozen=True)
class Case:
    """An incident: its topic and state, and whether its node is kept out for good."""

    id: int
    topic: str
    state: str
    kept_out: bool = False


@dataclass
class Seen:
    """A system at a moment.

    `now` in s; `heard` by topic; `cases` in the order in which they were told; `processes`: that of
    each node, as (pid, when it was made); `ours`: the substitutes' processes by node; `listed`: the
    substitutes that healing tells of; `healers`: what each uses.
    """

    now: float
    heard: Mapping[str, Heard] = field(default_factory=dict)
    cases: List[Case] = field(default_factory=list)
    processes: Dict[str, Tuple[int, float]] = field(default_factory=dict)
    ours: Dict[str, int] = field(default_factory=dict)
    listed: FrozenSet[str] = frozenset()
    healers: Dict[str, Usage] = field(default_factory=dict)


@dataclass(frozen=True)
class Violation:
    """A rule that did not hold, about what, and what was seen."""

    rule: str
    about: str
    seen: str


class Overlap(NamedTuple):
    """Two publishers were heard in turns, for `lasted` s from `begun` on."""

    lasted: float
    begun: float = 0.0
    who: Tuple[str, ...] = ()


def overlap(heard: Heard, period: float) -> Overlap:
    """Return the longest time in which two publishers were heard in turns.

    A message between two of another publisher, which are no further apart than two periods, is
    one of two voices.
    """
    longest, begun, last = Overlap(0.0), 0.0, float("-inf")
    for (at, who), (between, other), (then, again) in zip(heard, heard[1:], heard[2:]):
        if who == again != other and then - at <= SANDWICH_PERIODS * period:
            if between - last > SANDWICH_PERIODS * period:
                begun = between
            last = between
            longest = max(longest, Overlap(last - begun, begun, (who, other)))
    return longest


def voices(heard: Heard, since: float) -> List[str]:
    """Return the publishers heard since a moment."""
    return sorted({who for at, who in heard if at >= since})


def unsettled(topics: Sequence[Topic], seen: Seen) -> List[Violation]:
    """Return what is wrong when nothing fails any more; empty: the system has settled."""
    found = [
        Violation("every incident ends", case.topic, f"incident {case.id} is {case.state}")
        for case in newest(seen.cases).values()
        if case.state != "ended"
    ]
    for topic in topics:
        if topic.needed:
            found += _served(topic, seen)
    found += [
        Violation("no orphan", node, f"process {pid} is a substitute that healing does not list")
        for node, pid in sorted(seen.ours.items())
        if node not in seen.listed
    ]
    return found


def newest(cases: Sequence[Case]) -> Dict[str, Case]:
    """Return the newest incident of each topic, of cases in the order in which they were told."""
    return {case.topic: case for case in cases}


def _served(topic: Topic, seen: Seen) -> Iterator[Violation]:
    heard = seen.heard.get(topic.name, ())
    silence = seen.now - heard[-1][0] if heard else float("inf")
    if silence > topic.deadline:
        yield Violation("every needed topic is served", topic.name, f"silent for {silence:.2f} s")
        return
    who = set(voices(heard, seen.now - SERVED_S))
    if len(who) > len(topic.nodes) or not who <= topic.nodes:
        text = f"heard in the last {SERVED_S:g} s: {', '.join(sorted(who))}"
        yield Violation("one publisher a topic", topic.name, text)


def during(
    topics: Sequence[Topic],
    before: Seen,
    after: Seen,
    since: float,
    faulty: FrozenSet[str],
    doubled: FrozenSet[str],
) -> List[Violation]:
    """Return the violations in a step, from `since` on.

    `faulty`: the nodes that were made to fail; `doubled`: topics on which a stranger published on
    purpose.
    """
    found = []
    for topic in topics:
        heard = [each for each in after.heard.get(topic.name, ()) if each[0] >= since]
        both = overlap(heard, topic.period) if len(topic.nodes) == 1 else Overlap(0.0)
        if topic.name not in doubled and both.lasted > topic.period:
            text = (
                f"{' and '.join(both.who)} were heard in turns for {both.lasted * 1000:.0f} ms, "
                f"{both.begun - since:.2f} s after the step began"
            )
            found.append(Violation("one publisher a topic", topic.name, text))
    for node, process in before.processes.items():
        if node not in faulty and after.processes.get(node) != process:
            text = "its process has ended, though it did not fail"
            found.append(Violation("nobody innocent is killed", node, text))
    return found


def unanswered(topics: Sequence[Topic], seen: Seen, failed: Mapping[str, float]) -> List[Violation]:
    """Return needed topics that were silent at the end of a fault, without an incident.

    `failed`: the topics of the faulty nodes, and when their fault began; a silence that is younger
    than two deadlines need not have been seen yet.
    """
    known = newest(seen.cases)
    found = []
    for topic in topics:
        heard = seen.heard.get(topic.name, ())
        silence = seen.now - heard[-1][0] if heard else float("inf")
        begun = failed.get(topic.name)
        if not topic.needed or begun is None or silence <= topic.deadline:
            continue
        case = known.get(topic.name)
        told = case is not None and case.state in REST[1:]
        if not told and seen.now - begun > 2.0 * topic.deadline + SERVED_S:
            state = f"its incident is {case.state}" if case is not None else "there is no incident"
            text = f"silent for {silence:.2f} s, and {state}"
            found.append(Violation("served, or reported as unhealed", topic.name, text))
    return found


def grown(first: Seen, now: Seen, limits: Limits) -> List[Violation]:
    """Return the healers that use more than they may."""
    found = []
    for name, usage in now.healers.items():
        before: Optional[Usage] = first.healers.get(name)
        if before is None:
            continue
        for what in ("memory_bytes", "descriptors", "threads"):
            more = getattr(usage, what) - getattr(before, what)
            if more > getattr(limits, what):
                found.append(Violation("healers are bounded", name, f"{what}: {more} more"))
    return found

"""Whether a faulty node is killed: decided by what would be lost with it."""
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

from shsa_core.model.checks import BY_VALUE
from shsa_core.model.kinds import QUIET, Contain, Kind


@dataclass(frozen=True)
class Case:
    """A node that failed on one topic, and what is known of the rest.

    `contain`: what the SOM says of the failed service. `restarted`: by its policy the node is
    started again. `never`: why it is never killed, whatever the SOM says of this service.
    `protected`: why it is never killed unless the SOM says so; empty: it may be.
    `replaced`: something takes the failed service over. `costs`: the needed topics that would be
    lost with the node, and that nothing replaces. `useful`: the topics that it publishes well.
    `was_good`: it has published the failed topic well before. `gated`: a gate stands between it and
    the consumers of that topic.
    """

    node: str
    topic: str
    kind: Kind
    contain: Optional[Contain] = None
    restarted: bool = False
    never: str = ""
    protected: str = ""
    replaced: bool = False
    costs: Tuple[str, ...] = ()
    useful: Tuple[str, ...] = ()
    was_good: bool = True
    gated: bool = False


@dataclass(frozen=True)
class Verdict:
    """Whether the node is killed, and why, in words."""

    kill: bool
    why: str


def decide(case: Case) -> Verdict:
    """What is done about a faulty node: docs/killing.md has it as a table."""
    topic, gone = case.topic, case.kind is Kind.NODE_GONE
    killed = f"{case.node} is {'ended if it still runs' if gone else 'killed'}"
    kept = f"{case.node} is {'left alone if it still runs' if gone else 'kept'}"
    if case.never:
        return Verdict(False, f"{kept}: {case.never}")
    if case.contain is Contain.NODE:
        return Verdict(True, f"{killed}: the SOM says so of {topic}")
    if case.contain is Contain.NONE:
        return Verdict(False, f"{kept}: the SOM says so of {topic}")
    if case.protected:
        return Verdict(False, f"{kept}: {case.protected}")
    if case.restarted:
        return Verdict(True, f"{killed}: its policy is to start it again")
    if case.gated and case.kind not in (*QUIET, Kind.REQUESTED):
        return Verdict(False, f"{kept}: a gate keeps from consumers what it publishes on {topic}")
    if case.costs:
        lost = f"killing it would cost {_enumerated(case.costs)}, which nothing can replace"
        return Verdict(False, f"{kept}: {lost}")
    if case.kind in BY_VALUE and not case.was_good:
        # By the same numbers a substitute may be no better, and then there would be nobody.
        why = f"{topic} was never good: it may not be ready yet, or the SOM is wrong"
        return Verdict(False, f"{kept}: {why}")
    if case.replaced:
        return Verdict(True, f"{killed}: what is needed of it is taken over")
    nothing = f"nothing can replace {topic}"
    if case.kind is Kind.REQUESTED:
        return Verdict(False, f"{kept}: {nothing}")
    if case.kind in QUIET:
        return Verdict(False, f"{kept}: {nothing}, and it may speak again")
    if case.useful:
        well = f"it still publishes {_enumerated(case.useful)}"
        return Verdict(False, f"{kept}: {nothing}, and {well}")
    return Verdict(True, f"{killed}: it publishes nothing else that is good")


def _enumerated(topics: Sequence[str]) -> str:
    return " and ".join([", ".join(topics[:-1]), topics[-1]] if len(topics) > 1 else topics)

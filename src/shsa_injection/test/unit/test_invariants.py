"""Invariants after a step of chaos, and what is said where one does not hold."""
from typing import Any, Dict, List, Tuple

import pytest

from shsa_injection.invariants import (
    Case,
    Limits,
    Seen,
    Topic,
    Usage,
    Violation,
    during,
    grown,
    overlap,
    unanswered,
    unsettled,
    voices,
)

PERIOD_S = 0.02
CURRENT = Topic("/current", frozenset({"/meter"}), PERIOD_S, 0.25, True)
NONE: frozenset = frozenset()


def stream(who: str, first: float, last: float) -> List[Tuple[float, str]]:
    count = round((last - first) / PERIOD_S)
    return [(first + n * PERIOD_S, who) for n in range(count)]


def heard(*streams: List[Tuple[float, str]]) -> List[Tuple[float, str]]:
    return sorted(each for part in streams for each in part)


def seen(messages: List[Tuple[float, str]], now: float = 10.0, **others: Any) -> Seen:
    return Seen(now=now, heard={"/current": messages}, **others)


def rules(found: List[Violation]) -> List[str]:
    return [each.rule for each in found]


def test_a_clean_switch_and_a_gap_are_no_overlap() -> None:
    both = heard(stream("a", 0.0, 1.0), stream("b", 1.005, 2.0), stream("a", 3.0, 4.0))
    assert overlap(both, PERIOD_S).lasted == 0.0


def test_one_late_message_is_an_overlap_within_a_period() -> None:
    both = heard(stream("a", 0.0, 1.0), stream("b", 0.985, 2.0))
    assert overlap(both, PERIOD_S).lasted <= PERIOD_S


def test_two_voices_at_once_are_measured() -> None:
    both = heard(stream("a", 0.0, 1.0), stream("b", 0.905, 2.0))
    assert overlap(both, PERIOD_S).lasted == pytest.approx(0.09, abs=0.03)


def test_two_overlaps_are_measured_each_for_itself() -> None:
    both = heard(
        stream("a", 0.0, 1.0),
        stream("b", 0.905, 3.0),
        stream("a", 2.955, 4.0),
    )
    assert overlap(both, PERIOD_S).lasted < 0.15


def test_voices() -> None:
    both = heard(stream("a", 0.0, 1.0), stream("b", 1.005, 2.0))
    assert voices(both, 0.5) == ["a", "b"] and voices(both, 1.2) == ["b"]


def test_a_system_that_has_settled() -> None:
    cases = [Case(1, "/current", "healed"), Case(2, "/current", "ended")]
    ours = {"/substitute_standby_1": 5}
    now = seen(stream("/meter", 8.0, 10.0), cases=cases, ours=ours, listed=frozenset(ours))
    assert unsettled([CURRENT], now) == []


@pytest.mark.parametrize(
    "messages, others, rule",
    [
        (stream("/meter", 8.0, 9.0), {}, "every needed topic is served"),
        ([], {}, "every needed topic is served"),
        (stream("/x", 8.0, 10.0), {}, "one publisher a topic"),
        (heard(stream("/meter", 8.0, 10.0), stream("/x", 8.0, 10.0)), {}, "one publisher a topic"),
        (
            stream("/meter", 8.0, 10.0),
            {"cases": [Case(3, "/current", "healed")]},
            "every incident ends",
        ),
        (stream("/meter", 8.0, 10.0), {"ours": {"/substitute_standby_1": 5}}, "no orphan"),
    ],
)
def test_what_has_not_settled(
    messages: List[Tuple[float, str]], others: Dict[str, Any], rule: str
) -> None:
    assert rules(unsettled([CURRENT], seen(messages, **others))) == [rule]


def test_a_topic_that_nobody_needs_may_be_silent() -> None:
    idle = Topic("/current", frozenset({"/meter"}), PERIOD_S, 0.25, False)
    assert unsettled([idle], seen([])) == []


def test_nobody_innocent_is_killed_and_who_failed_may_be() -> None:
    before = seen([], processes={"/meter": (5, 1.0), "/wheels": (6, 1.0)})
    after = seen([], processes={"/meter": (9, 2.0)})
    faulty = frozenset({"/meter"})
    found = during([CURRENT], before, after, 0.0, faulty, NONE)
    assert [(each.rule, each.about) for each in found] == [("nobody innocent is killed", "/wheels")]


def test_two_voices_in_a_step_count_unless_a_stranger_was_meant_to_publish() -> None:
    both = heard(stream("/meter", 1.0, 2.0), stream("/substitute_1", 1.905, 3.0))
    after = seen(both)
    assert rules(during([CURRENT], seen([]), after, 0.5, NONE, NONE)) == ["one publisher a topic"]
    assert not during([CURRENT], seen([]), after, 0.5, NONE, frozenset({"/current"}))
    assert not during([CURRENT], seen([]), after, 2.5, NONE, NONE), "before the step"


@pytest.mark.parametrize(
    "state, told", [("unhealed", True), ("safe", True), ("kept", True), ("healing", False)]
)
def test_a_silent_topic_must_be_reported(state: str, told: bool) -> None:
    now = seen(stream("/meter", 4.0, 5.0), cases=[Case(1, "/current", state)])
    found = unanswered([CURRENT], now, {"/current": 5.0})
    assert (found == []) is told
    nothing = seen(stream("/meter", 4.0, 5.0))
    assert "there is no incident" in unanswered([CURRENT], nothing, {"/current": 5.0})[0].seen
    assert not unanswered([CURRENT], nothing, {"/current": 9.5}), "too young"
    assert not unanswered([CURRENT], nothing, {}), "it did not fail"


def test_healers_are_bounded() -> None:
    first = seen([], healers={"/monitor": Usage(10**7, 20, 10)})
    limits = Limits(10**6, 5, 2)
    assert not grown(
        first, seen([], healers={"/monitor": Usage(10**7 + 10**6, 25, 12)}), limits
    )
    more = seen([], healers={"/monitor": Usage(2 * 10**7, 26, 13), "/new": Usage(10**9, 1, 1)})
    assert len(grown(first, more, limits)) == 3

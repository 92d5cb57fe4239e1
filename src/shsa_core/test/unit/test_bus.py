"""The statistics that a node sends, in the two forms that ROS has."""
from typing import Any, Optional

import pytest

from shsa_core.ros.master.node_api import COUNTER, Answer, Sent, between, rate, sent
from strange_nodes import Send, StrangeNode, nothing, value

TOPIC = "/speed"
OTHER = ["/other", 9, [[1, 9, 9, True]]]
ROSPY = [TOPIC, 800, [[3, 900, 100, True], [4, 90, 10, True]]]
ROSCPP = [TOPIC, [[3, 900, 800, 100, 0], [4, 90, 80, 10, 0]]]


S = 1_000_000_000


def look(publishers: Any, at: int = 0) -> Optional[Sent]:
    return sent(Answer([publishers, [], []], at, at), TOPIC)


def test_the_counters_of_rospy_and_of_roscpp_are_read() -> None:
    assert look([OTHER, ROSPY], 5) == Sent(800, {3: 100, 4: 10}, 5)
    assert look([ROSCPP], 5) == Sent(0, {3: 100, 4: 10}, 5)
    assert look([[TOPIC, []]]) == Sent(0, {}, 0)


@pytest.mark.parametrize(
    "nonsense", [[], [OTHER], None, 7, [[]], [[TOPIC, 7]], [[TOPIC, [["a", 1, 2, 3]]]], [[TOPIC]]]
)
def test_an_answer_that_makes_no_sense_tells_nothing(nonsense: Any) -> None:
    assert look(nonsense) in (None, Sent(0, {}, 0))


@pytest.mark.parametrize(
    "first, second, expected",
    [
        (Sent(0, {1: 5, 2: 5}, 0), Sent(9, {1: 5, 2: 30}, S // 2), 50.0),
        (Sent(9, {1: 5}, 0), Sent(9, {1: 5}, S), 0.0),
        (Sent(0, {1: COUNTER - 1}, 0), Sent(0, {1: 9}, S), 10.0),
        (Sent(9, {}, 0), Sent(9, {}, S), None),
        (Sent(9, {1: 5}, 0), Sent(9, {2: 5}, S), None),
        (Sent(9, {1: 5}, 0), Sent(99, {1: 5}, S), None),
    ],
    ids=["the best served", "silent", "wrapped", "nobody", "others by now", "all held up"],
)
def test_who_is_served_best_tells_the_rate(
    first: Sent, second: Sent, expected: Optional[float]
) -> None:
    assert between(first, second) == expected


@pytest.mark.parametrize(
    "answer, expected",
    [
        (value([1, "", [[ROSPY], [], []]]), 0.0),
        (value([[ROSCPP], []]), 0.0),  # roscpp says no status here
        (value([1, "", [[[TOPIC, []]], [], []]]), None),
        (value([0, "what?", 0]), None),
        (value(7), None),
        (nothing, 0.0),
    ],
    ids=["rospy", "roscpp", "nobody is connected", "refused", "nonsense", "hung"],
)
def test_a_node_is_asked_twice(answer: Send, expected: Optional[float]) -> None:
    node = StrangeNode(answer)
    try:
        assert rate(node.uri, TOPIC, 0.01) == expected
    finally:
        node.end()


def test_who_does_not_listen_at_all_sends_nothing() -> None:
    node = StrangeNode(nothing)
    node.end()
    assert rate(node.uri, TOPIC, 0.01) == 0.0

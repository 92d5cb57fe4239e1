"""Registrations that a master that was started anew is told again."""
import itertools
from typing import Any, Dict, List

import pytest

from shsa_core.analysis.registrations import (
    NOTHING,
    Graph,
    Part,
    Registration,
    Said,
    is_name,
    missing_parameters,
    read_pairs,
    to_ask,
    to_register,
    to_tell,
    together,
)

A, B = "http://a:1/", "http://b:2/"
KNOWN = Graph(
    {
        Part.PUBLISHER: frozenset({("/x", "/a")}),
        Part.SUBSCRIBER: frozenset({("/x", "/b"), ("/y", "/b")}),
        Part.SERVICE: frozenset({("/serve", "/a")}),
    },
    {"/a": A, "/b": B},
    {"/serve": "rosrpc://a:3"},
)


def said_of(published: Dict[str, str], subscribed: Dict[str, str]) -> Said:
    """Return what a node says of itself."""
    return {Part.PUBLISHER: published, Part.SUBSCRIBER: subscribed}


SAID = {"/a": said_of({"/x": "t/X"}, {}), "/b": said_of({}, {"/x": "t/X", "/y": "t/Y"})}


@pytest.mark.parametrize("name", ["/driver", "/robots/1/driver", "/1", "/a_b/_c"])
def test_a_name_may_be_any_that_ros_allows(name: str) -> None:
    assert is_name(name)
    assert read_pairs([[name, ["/a"]]]) == frozenset({(name, "/a")})


@pytest.mark.parametrize("name", ["", "/", "driver", "/a b", "/a;b", "/a//b", "/a/", 7])
def test_what_no_node_can_be_called_is_no_name(name: Any) -> None:
    assert not is_name(name)


def test_all_that_was_known_is_registered_and_publishers_come_first() -> None:
    assert to_ask(KNOWN, NOTHING) == {"/a": A, "/b": B}
    assert to_register(KNOWN, NOTHING, SAID) == [
        Registration(Part.PUBLISHER, "/a", "/x", "t/X", A),
        Registration(Part.SERVICE, "/a", "/serve", "rosrpc://a:3", A),
        Registration(Part.SUBSCRIBER, "/b", "/x", "t/X", B),
        Registration(Part.SUBSCRIBER, "/b", "/y", "t/Y", B),
    ]
    assert not to_ask(KNOWN, KNOWN) and not to_register(KNOWN, KNOWN, SAID)


@pytest.mark.parametrize("uris, told", [([], False), ([A], False), ([A, "http://new:1/"], True)])
def test_subscribers_are_told_of_who_came_up_while_they_were_asked(
    uris: List[str], told: bool
) -> None:
    """The master tells those whom it knows, and that publisher was not there yet as it was read."""
    subscriber = Registration(Part.SUBSCRIBER, "/b", "/x", "t/X", B)
    found = list(to_tell([(subscriber, uris)], KNOWN, NOTHING, {"/a", "/b"}))
    assert found == ([([B], "/x", uris)] if told else [])


def test_who_does_not_answer_is_not_registered() -> None:
    only_b = {"/b": SAID["/b"]}
    assert {each.node for each in to_register(KNOWN, NOTHING, only_b)} == {"/b"}


def test_what_a_node_has_left_is_not_registered_and_neither_is_what_nobody_knew() -> None:
    said = {"/b": said_of({"/z": "t/Z"}, {"/y": "t/Y", "/cmd_vel": "t/T"})}
    assert [each.name for each in to_register(KNOWN, NOTHING, said)] == ["/y"]


def test_a_node_that_has_not_answered_yet_is_not_forgotten() -> None:
    others = to_register(KNOWN, NOTHING, {"/b": SAID["/b"]})
    subscribed = frozenset((each.name, each.node) for each in others)
    parts = {**NOTHING.parts, Part.SUBSCRIBER: subscribed}
    now = Graph(parts, {"/b": B, "/c": "http://c:1/"}, {})
    both = together(now, KNOWN, ["/a"])
    assert both == KNOWN._replace(nodes={**KNOWN.nodes, "/c": "http://c:1/"})
    assert together(now, KNOWN, []) == now


def test_who_is_somewhere_else_by_now_is_left_alone() -> None:
    parts = {**NOTHING.parts, Part.PUBLISHER: frozenset({("/other", "/a")})}
    now = Graph(parts, {"/a": "http://a:9/"}, {})
    assert to_ask(KNOWN, now) == {"/b": B}
    assert {each.node for each in to_register(KNOWN, now, SAID)} == {"/b"}


def test_a_stranger_that_answers_is_not_registered() -> None:
    assert not to_register(KNOWN, KNOWN, {"/stranger": said_of({"/x": "t/X"}, {})})
    assert not to_register(KNOWN, NOTHING, {"/stranger": said_of({"/x": "t/X"}, {})})


@pytest.mark.parametrize("present", itertools.product((False, True), repeat=4))
def test_whatever_is_there_already_the_graph_is_whole_afterwards(present: Any) -> None:
    pairs = [("/x", "/a"), ("/x", "/b"), ("/y", "/b"), ("/serve", "/a")]
    there = {pair for pair, is_there in zip(pairs, present) if is_there}
    parts = {part: pairs & there for part, pairs in KNOWN.parts.items()}
    now = Graph(parts, {node: KNOWN.nodes[node] for _, node in there}, {})
    told = {(each.name, each.node) for each in to_register(KNOWN, now, SAID)}
    assert told | there == set(pairs) and not told & there


@pytest.mark.parametrize(
    "rows",
    [
        None,
        "text",
        7,
        [["/x", "/a"]],
        [["/x"]],
        [["/x", ["/a;touch x", "a", "/a b", "", 3, None, "/" + 2000 * "a", "/²"]]],
        [[{"a": 1}, ["/a"]]],
        [["/x", [f"/n{number}" for number in range(100_001)]]],
    ],
)
def test_what_is_no_state_tells_nothing(rows: Any) -> None:
    assert read_pairs(rows) == frozenset()


def test_what_is_no_name_hides_nobody() -> None:
    assert read_pairs([["/x", ["/a", "; rm"]], ["", ["/a"]]]) == {("/x", "/a")}


PARAMETERS: Dict[str, Any] = {
    "run_id": "old",
    "shsa": {"som": {"a": 1, "b": 2}},
    "rosversion": "1",
    "two words": 1,
    "text": "",
}
RESTORED: List[Any] = [
    ({}, [("/shsa", {"som": {"a": 1, "b": 2}}), ("/rosversion", "1"), ("/text", "")]),
    (
        {"shsa": {"som": {"a": 5}}, "rosversion": "2", "run_id": "new"},
        [("/shsa/som/b", 2), ("/text", "")],
    ),
    ({"shsa": 3, "rosversion": {"x": 1}, "text": "t"}, []),
]


@pytest.mark.parametrize("now, found", RESTORED)
def test_parameters_that_are_gone_are_set_again_and_others_stay(now: Any, found: Any) -> None:
    assert missing_parameters(PARAMETERS, now) == found

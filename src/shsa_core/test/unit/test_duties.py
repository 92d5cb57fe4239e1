"""The duties of a node: what the robot loses with it beyond the SOM."""
from dataclasses import replace
from typing import Dict, FrozenSet, Set, Tuple

import pytest

from core_robot import A, B, service
from shsa_core.analysis.duties import duties_of
from shsa_core.model.names import Names
from shsa_core.model.som import Som

SOM = Som([service("a", A, needed=True, derived_from=("b",)), service("b", B)])
Listed = Set[Tuple[str, str]]


def duties(
    publishes: Listed, subscribes: Listed = set(), serves: Listed = set(), also: str = A
) -> object:
    """Return the duties of A, which publishes /a besides; nobody but `also` has any."""
    listed = publishes | {("/a", A), ("/rosout", A)}
    loggers = {(f"{A}/get_loggers", A), (f"{A}/set_logger_level", A)}
    parts = frozenset(listed), frozenset(subscribes), frozenset(serves | loggers)
    found: Dict[str, Tuple[str, ...]] = duties_of(SOM, Names("/"), *parts)
    assert set(found) <= {A, also}
    return found.get(A, ())


def on(node: str, *topics: str) -> Listed:
    return {(topic, node) for topic in topics}


ACTION = "/move/status", "/move/feedback", "/move/result"
ASKED = "/move/goal", "/move/cancel"


@pytest.mark.parametrize(
    "publishes, subscribes, serves, expected",
    [
        (set(), on(A, "/b", "/clock", "/tf", "/tf_static"), set(), ()),
        (set(), on("/user", "/a", "/rosout"), set(), ()),
        (on(A, "/x", "/diagnostics"), on("/user", "/diagnostics"), set(), ()),
        (on(A, "/x"), on("/monitor", "/x") | on("/substitute_a_3", "/x"), set(), ()),
        (set(), on(A, "/cmd_vel"), set(), ("takes /cmd_vel",)),
        (on(A, "/tf"), on(A, "/cmd_vel"), set(), ("takes /cmd_vel", "broadcasts tf")),
        (on(A, *ACTION), on(A, *ASKED), set(), ("serves the action /move",)),
        (on(A, *ASKED), on(A, *ACTION) | on("/move_base", *ASKED), set(), ()),
        (set(), set(), on(A, "/reset", f"{A}/set_parameters"), ("serves /reset",)),
        (on(A, "/x"), on("/user", "/x"), set(), ("publishes /x",)),
        (set(), on(A, "/p", "/q", "/r", "/s", "/t"), set(), ("takes /p, /q, /r and 2 more",)),
        (set(), on(A, "/shsa/incidents"), set(), ()),
        (on(A, "/clock"), set(), set(), ("tells the time",)),
    ],
)
def test_what_the_master_lists_tells_the_duties(
    publishes: Listed, subscribes: Listed, serves: Listed, expected: Tuple[str, ...]
) -> None:
    assert duties(publishes, subscribes, serves) == expected


@pytest.mark.parametrize(
    "topic, type_, expected",
    [
        ("/cmd_vel", "test_msgs/Any", "takes /cmd_vel"),
        ("/arm/command", "test_msgs/Any", "takes /arm/command"),
        ("/drive", "geometry_msgs/Twist", "takes /drive"),
        ("/measured", "geometry_msgs/TwistStamped", ""),
        ("/recommended", "nav_msgs/Odometry", ""),
        ("/moves", "geometry_msgs/TwistWithCovarianceStamped", ""),
    ],
)
def test_who_takes_commands_has_a_duty_where_the_som_knows_them_too(
    topic: str, type_: str, expected: str
) -> None:
    commands = replace(service("commands", B), topic=topic, type=type_)
    a, told = service("a", A, derived_from=("commands",)), frozenset({("/a", A), (topic, B)})
    som, heard = Som([a, commands]), frozenset({(topic, A), (topic, B)})
    found = duties_of(som, Names("/"), told, heard, frozenset())
    assert found.get(A, ()) == ((expected,) if expected else ())


@pytest.mark.parametrize("gives", [True, False])
@pytest.mark.parametrize("type_", ["std_msgs/Float64", "geometry_msgs/TwistStamped"])
@pytest.mark.parametrize("derived_from", [("target",), ("/target",), ("/other",), ()])
def test_what_another_node_says_is_a_command_unless_the_values_are_derived_from_it(
    derived_from: Tuple[str, ...], type_: str, gives: bool
) -> None:
    """Of any name, and though who gives it does not listen, or is not there."""
    target = replace(service("target", B), topic="/target", type=type_)
    som = Som([service("a", A, derived_from=derived_from), target])
    told = frozenset({("/a", A), *([("/target", B)] if gives else [])})
    found = duties_of(som, Names("/"), told, frozenset({("/target", A)}), frozenset())
    assert duties_of(som, Names("/"), told, frozenset({("/other", A)}), frozenset()) == (
        {} if derived_from == ("/other",) else {A: ("takes /other",)}
    )
    measured = bool({"target", "/target"} & {*derived_from})
    assert found.get(A, ()) == (() if measured else ("takes /target",))
    own = Som([service("a", A)])
    heard = frozenset({("/a", A)})
    assert duties_of(own, Names("/"), heard | {("/a", "/stranger")}, heard, frozenset()) == {}


@pytest.mark.parametrize("topic", ["/arm/elbow_controller/command", "/left_wheel/target", "/x"])
def test_a_command_of_any_name_and_type_is_a_duty_also_if_nobody_gives_it(topic: str) -> None:
    assert duties(on("/control", topic), on(A, topic)) == (f"takes {topic}",)
    assert duties(set(), on(A, topic)) == (f"takes {topic}",)


@pytest.mark.parametrize("also", ["/substitute_b_1", "/monitor", A])
def test_what_answers_a_node_is_a_command_though_the_som_has_it_as_a_service(also: str) -> None:
    heard = on(A, "/b") | on(also, "/a", "/b")
    assert duties(on(B, "/b") | on(also, "/b"), heard) == ()
    assert duties(on(B, "/b"), heard | on(B, "/a"), also=B) == ("takes /b",)


def test_nodes_of_healing_and_those_that_the_som_does_not_concern_have_none() -> None:
    pairs = frozenset({("/a", "/substitute_a_1"), ("/other", "/other_node")})
    heard = frozenset({("/x", "/substitute_a_1"), ("/y", "/other_node")})
    assert duties_of(SOM, Names("/"), pairs, heard, frozenset()) == {}


def test_a_node_that_is_gone_keeps_its_duties_until_it_is_listed_again() -> None:
    nobody: FrozenSet[Tuple[str, str]] = frozenset()
    before = {A: ("takes /cmd_vel",), "/stranger": ("broadcasts tf",)}
    gone = duties_of(SOM, Names("/"), nobody, nobody, nobody, had=before)
    assert gone == {A: ("takes /cmd_vel",)}
    back = duties_of(SOM, Names("/"), frozenset({("/a", A)}), nobody, nobody, had=before)
    assert back == {}

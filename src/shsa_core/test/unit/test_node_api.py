"""Whatever a strange node answers, a call ends in time, small, and with a failure that has a name.
"""
import resource
import time
from typing import Callable, Iterator, List, Tuple

import pytest

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, BadAnswer, address, ask, pid, topics
from shsa_core.ros.master.master_watch import MasterCalls
from strange_nodes import NONSENSE, Send, StrangeNode, bomb, drip, endless, nothing, value, zipped

NODES: List[StrangeNode] = []


@pytest.fixture(autouse=True)
def ended() -> Iterator[None]:
    yield
    while NODES:
        NODES.pop().end()


def node(otherwise: Send) -> str:
    NODES.append(StrangeNode(otherwise))
    return NODES[-1].uri


@pytest.mark.parametrize("kind", NONSENSE)
def test_nonsense_is_a_failure_with_a_name(kind: str) -> None:
    uri = node(NONSENSE[kind])
    calls: Tuple[Callable[[str], object], ...] = (pid, topics)
    for call in calls:
        with pytest.raises(FAILURES):
            call(uri)


@pytest.mark.parametrize("answer", [drip, nothing])
def test_a_call_has_one_deadline_from_its_begin_to_its_end(answer: Send) -> None:
    begin = time.monotonic()
    with pytest.raises(FAILURES):
        pid(node(answer))
    assert time.monotonic() - begin < 3 * settings.CALL_S


@pytest.mark.parametrize("answer", [endless, zipped])
def test_an_answer_has_a_largest_size(answer: Send) -> None:
    bomb()
    uri = node(answer)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(FAILURES):
        topics(uri)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_what_is_in_order_is_told() -> None:
    assert pid(node(value([1, "", 4242]))) == 4242
    rows = value([1, "ok", [["/odom", "nav_msgs/Odometry"], ["/rosout", "rosgraph_msgs/Log"]]])
    assert topics(node(rows)).keys() == {"/odom", "/rosout"}
    assert ask(node(value([1, "bye", 1])), "shutdown", "why") == 1


def test_the_master_may_tell_of_a_large_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    model = "<link/>" * 500_000  # as a robot's description may be
    told = value([[[1, "", {"robot_description": model}]]])
    monkeypatch.setenv("ROS_MASTER_URI", node(told))
    assert MasterCalls().parameters() == {"robot_description": model}


@pytest.mark.parametrize("rows", ["/odom", [["/odom"]], [["/odom", 4]], [["/a", "b", "c"]], 7, [7]])
def test_publications_of_another_form_are_none(rows: object) -> None:
    with pytest.raises(BadAnswer):
        topics(node(value([1, "", rows])))


@pytest.mark.parametrize(
    "uri",
    [
        "",
        "http://",
        "localhost:11311",
        "file:///etc/passwd",
        "http://host:0/",
        "http://host:99999/",
        "http://host:80:80/",
        "http://user@host:80/",
        "http://host:80/path",
        "http://ho st:80/",
        "http://host:80/\n",
        "http://host:\u0664\u0662/",
        "x" * 10_000,
        None,
        4,
        ["http://host:80/"],
    ],
)
def test_an_address_that_is_none_is_not_called(uri: str) -> None:
    with pytest.raises(BadAnswer):
        address(uri)
    with pytest.raises(BadAnswer):
        ask(uri, "getPid")


def test_addresses_of_nodes() -> None:
    assert address("http://robot-1.local:4242/") == ("robot-1.local", 4242)
    assert address("http://[::1]:4242") == ("::1", 4242)

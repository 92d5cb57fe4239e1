"""Whatever a strange node answers, a call ends in time, small, and with a failure that has a name.
"""
import resource
import time
from typing import Any, Callable, Iterator, List, Tuple

import pytest

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, BadAnswer, Originals, address, ask, master_api
from shsa_core.ros.master.node_api import pid, topics
from shsa_core.ros.master.master_watch import parameters
from strange_nodes import NONSENSE, Send, StrangeNode, bomb, drip, endless, nothing, value, zipped

NODES: List[StrangeNode] = []


@pytest.fixture(autouse=True)
def ended() -> Iterator[None]:
    yield
    while NODES:
        NODES.pop().end()


def node(otherwise: Send, **answers: Any) -> str:
    NODES.append(StrangeNode(otherwise, **answers))
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
    assert parameters() == {"robot_description": model}


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


@pytest.mark.parametrize("uri", ["localhost:11311", "junk", "", "http://", "http://a:99999"])
def test_a_master_uri_that_is_none_is_refused_in_words(
    monkeypatch: pytest.MonkeyPatch, uri: str
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    with pytest.raises(ShsaError) as refused:
        master_api("/test")
    assert str(refused.value).startswith(f"ROS_MASTER_URI is '{uri}': it must be http://HOST:PORT")


def test_addresses_of_nodes() -> None:
    assert address("http://robot-1.local:4242/") == ("robot-1.local", 4242)
    assert address("http://[::1]:4242") == ("::1", 4242)


TOPIC, NAME = "/speed", "/driver"
ENDS = [[number, name, "o", "TCPROS", TOPIC, True] for number, name in enumerate("xab")]
INFO = value([1, "", ENDS])


def original(monkeypatch: pytest.MonkeyPatch, otherwise: Send, **answers: Send) -> StrangeNode:
    """Return a node whose address a master tells."""
    uri = node(otherwise, **answers)
    monkeypatch.setenv("ROS_MASTER_URI", node(value([1, "", uri])))
    return NODES[-2]


@pytest.mark.parametrize("answer", [[1, "", 7], [1, "", [[["/speed"]]]], [1, "", [[7], 7]], "x"])
def test_an_original_that_answers_nonsense_serves_nobody(
    monkeypatch: pytest.MonkeyPatch, answer: Any
) -> None:
    asked = original(monkeypatch, value(answer))
    assert Originals().served_consumers(TOPIC, NAME) is None and asked.calls


def test_an_original_in_cpp_tells_whom_it_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    stats = [[[TOPIC, [[1, 60, 50, 5, 0], [2, 0, 0, 0, 0]]]], [], []]  # without a status
    original(monkeypatch, value(7), getBusStats=value(stats), getBusInfo=INFO)
    assert Originals().served_consumers(TOPIC, NAME) == {"a"}


def test_an_original_is_asked_who_its_consumers_are_once(monkeypatch: pytest.MonkeyPatch) -> None:
    stats: Any = [[[TOPIC, 9, [[1, 60, 60, False], [2, 0, 0, False]]]], [], []]
    tells = value([1, "", stats])
    asked = original(monkeypatch, value(7), getBusStats=tells, getBusInfo=INFO)
    originals = Originals()
    for _ in range(3):
        assert originals.served_consumers(TOPIC, NAME) == {"a"}
    assert asked.calls == {"getBusStats": 3, "getBusInfo": 1}
    stats[0][0][-1][1][2] = 60  # another one is served
    asked.tells(getBusStats=value([1, "", stats]))
    assert originals.served_consumers(TOPIC, NAME) == {"a", "b"}
    assert asked.calls == {"getBusStats": 4, "getBusInfo": 1}

"""Each command goes to the computer that it is about."""
from types import SimpleNamespace
from typing import Any, List, Tuple

import pytest
import rospy

from shsa_core.healing import events
from shsa_core.ros.agent import all_hosts
from shsa_core.ros.agent.all_hosts import AllHosts
from shsa_core.ros.settings import QUEUE
from shsa_testing.waiting import wait_until

Sent = List[Tuple[str, Any]]


class Remote:
    """A computer that has an agent."""

    def __init__(self, name: str, address: str, sent: Sent) -> None:
        self.addresses = (address, name)
        self._name, self._sent = name, sent

    def carry_out(self, command: Any, now: float) -> None:
        self._sent.append((self._name, command))

    def take_up(self) -> Tuple[str, ...]:
        return (f"/substitute_on_{self._name}",)


class Robot:
    """The computers pi and board beside our own, and who is where by the master's word."""

    def __init__(self) -> None:
        self.sent: Sent = []
        self.told: List[Any] = []
        self.uris = {"/a": "http://10.0.0.2:1/", "/b": "http://10.0.0.3:1/", "/c": "http://me:1/"}
        self.uris["/d"] = "http://10.0.0.9:1/"
        self.answers = True
        signing: Any = None
        self.hosts: Any = AllHosts(self, signing, self.told.append, "notebook")
        places = {"pi": "10.0.0.2", "board": "10.0.0.3"}
        self.hosts._remote = {name: Remote(name, at, self.sent) for name, at in places.items()}

    def carry_out(self, command: Any) -> None:
        """As the local Host."""
        self.sent.append(("", command))

    def getSystemState(self) -> Tuple[List[Any], ...]:
        return [], [], []

    def lookupNode(self, node: str) -> str:
        if not self.answers:
            raise OSError("no master")
        return self.uris[node]

    def do(self, *commands: Any) -> Sent:
        """Carry them out, one by one; what was sent."""
        self.sent.clear()
        for count, command in enumerate(commands, 1):
            self.hosts.carry_out(command)
            wait_until(lambda: len(self.sent) + len(self.told) >= count, 10.0, "it is sent")
        return list(self.sent)


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    robot = Robot()
    monkeypatch.setattr(all_hosts, "master_api", lambda: robot)
    monkeypatch.setattr(rospy, "get_node_uri", lambda: "http://me:99/")
    return robot


@pytest.mark.parametrize("node, home", [("/a", "pi"), ("/b", "board"), ("/c", ""), ("/d", "")])
def test_a_node_is_on_the_computer_of_its_address(robot: Robot, node: str, home: str) -> None:
    commands = [
        events.LearnNode(node, "/x"),
        events.FindNode(node),
        events.AskToLeave(node),
        events.EndProcess(node),
        events.ClearNode(node),
        events.RestartNode(node),
        events.StopNode(node),
    ]
    assert robot.do(*commands) == [(home, each) for each in commands]


def test_a_node_that_moved_is_found_and_one_stays_where_it_was_without_a_master(
    robot: Robot,
) -> None:
    assert robot.do(events.LearnNode("/a"))[0][0] == "pi"
    robot.uris["/a"] = "http://10.0.0.3:7/"
    assert robot.do(events.FindNode("/a"))[0][0] == "board"
    robot.answers = False
    assert robot.do(events.FindNode("/a"))[0][0] == "board"


@pytest.mark.parametrize("host, home", [("pi", "pi"), ("", ""), ("notebook", "")])
def test_a_substitute_is_where_it_was_started(robot: Robot, host: str, home: str) -> None:
    start = events.StartSubstitute("/substitute_a_1", None, host=host)
    stop = events.StopSubstitute("/substitute_a_1")
    assert robot.do(start, events.EndProcess("/substitute_a_1"), stop) == [
        (home, start),
        (home, events.EndProcess("/substitute_a_1")),
        (home, stop),
    ]


def test_a_substitute_on_an_unknown_computer_is_refused(robot: Robot) -> None:
    assert robot.do(events.StartSubstitute("/substitute_a_1", None, host="moon")) == []
    assert robot.told[0].detail == "moon is none of the hosts: pi, board"


def test_what_ran_before_is_where_it_was_found(robot: Robot) -> None:
    assert robot.hosts.take_up() == ["/substitute_on_pi", "/substitute_on_board"]
    stop = events.StopSubstitute("/substitute_on_board")
    assert robot.do(stop) == [("board", stop)]


def test_nodes_are_awaited_here_and_by_their_own_agent(robot: Robot) -> None:
    robot.do(events.LearnNode("/a"), events.LearnNode("/c"))
    watch = events.WatchNodes(("/a", "/c"))
    assert robot.do(watch) == [("", watch), ("pi", events.WatchNodes(("/a",)))]
    assert robot.do(watch) == [("", watch)]  # the agent knows
    none = events.WatchNodes(())
    assert robot.do(none) == [("", none), ("pi", none)]


def test_with_one_computer_the_master_is_not_asked(robot: Robot) -> None:
    robot.hosts._remote, robot.answers = {}, False
    robot.hosts.carry_out(events.FindNode("/a"))
    assert robot.sent == [("", events.FindNode("/a"))]


def test_what_waits_for_an_agent_that_hangs_is_bounded(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: List[Any] = []
    monkeypatch.setattr(rospy.Publisher, "__init__", lambda *what, **how: made.append(how))
    robot.hosts._signing = SimpleNamespace(signer=lambda *what: None)
    robot.hosts._host("pi")
    assert 0 < made[0]["queue_size"] <= QUEUE

"""Each command goes to the computer that it is about."""
import errno
import threading
import time
from types import SimpleNamespace
from typing import Any, List, Tuple
from unittest.mock import Mock

import pytest
import rospy

from shsa_core.healing import events
from shsa_core.ros import settings
from shsa_core.ros.agent import agent
from shsa_core.ros.agent.all_hosts import AllHosts
from shsa_core.ros.settings import QUEUE
from shsa_core.ros.trust import signing

Sent = List[Tuple[str, Any]]


class Remote:
    """A computer that has an agent."""

    def __init__(self, name: str, sent: Sent, seen: bool) -> None:
        self._name, self._sent, self.seen = name, sent, seen

    def carry_out(self, command: Any, now: float) -> None:
        self._sent.append((self._name, command))

    def take_up(self) -> Tuple[str, ...]:
        return (f"/substitute_on_{self._name}",)


class Robot:
    """The computers pi and board beside our own, attic without an agent, and who is where."""

    def __init__(self) -> None:
        self.sent: Sent = []
        self.told: List[Any] = []
        homes = {"/a": "pi", "/b": "board", "/d": "attic", "/e": "moon"}
        host_of = lambda node: homes.get(node, "")
        signing: Any = None
        self.hosts: Any = AllHosts(self.carry_out, signing, self.told.append, host_of, "notebook")
        seen = {"pi": True, "board": True, "attic": False}
        self.hosts._remote = {name: Remote(name, self.sent, heard) for name, heard in seen.items()}

    def carry_out(self, command: Any) -> None:
        """As the local Host."""
        self.sent.append(("", command))

    def do(self, *commands: Any) -> Sent:
        """Carry them out, one by one; what was sent."""
        self.sent.clear()
        for command in commands:
            self.hosts.carry_out(command)
        return list(self.sent)


@pytest.fixture
def robot() -> Robot:
    return Robot()


@pytest.mark.parametrize(
    "node, home", [("/a", "pi"), ("/b", "board"), ("/c", ""), ("/d", ""), ("/e", "")]
)
def test_a_node_is_where_the_som_says_if_there_is_an_agent(
    robot: Robot, node: str, home: str
) -> None:
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


@pytest.mark.parametrize("host, home", [("pi", "pi"), ("", ""), ("notebook", "")])
def test_a_substitute_is_where_it_was_started(robot: Robot, host: str, home: str) -> None:
    start = events.StartSubstitute("/substitute_a_1", None, host=host)
    stop = events.StopNode("/substitute_a_1")
    assert robot.do(start, events.EndProcess("/substitute_a_1"), stop) == [
        (home, start),
        (home, events.EndProcess("/substitute_a_1")),
        (home, stop),
    ]


def test_what_ran_before_is_where_it_was_found(robot: Robot) -> None:
    assert robot.hosts.take_up()[:2] == ["/substitute_on_pi", "/substitute_on_board"]
    stop = events.StopNode("/substitute_on_board")
    assert robot.do(stop) == [("board", stop)]


def test_nodes_are_awaited_everywhere(robot: Robot) -> None:
    watch = events.WatchNodes(("/a", "/c"))
    assert robot.do(watch) == [(host, watch) for host in ("", "pi", "board", "attic")]


def test_what_waits_for_an_agent_that_hangs_is_bounded(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: List[Any] = []
    monkeypatch.setattr(signing, "advertise", lambda *what: made.append(what))
    robot.hosts._signing = SimpleNamespace(signer=lambda *what: None)
    robot.hosts._host("pi")
    (_, _, size, _), *_ = made
    assert 0 < size <= QUEUE


def test_an_agent_goes_on_where_it_has_no_descriptor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its load is told by files of the kernel."""
    end = time.monotonic() + 10.0
    monkeypatch.setattr(rospy, "is_shutdown", lambda: len(said) > 1 or time.monotonic() > end)
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    monkeypatch.setattr(agent, "repeating", Mock())
    said: List[str] = []
    load = Mock(look=Mock(side_effect=OSError(errno.EMFILE, "too many open files")))
    node = agent.AgentNode.__new__(agent.AgentNode)
    parts = {"_name": "pi", "_load": load, "_say": said.append}
    vars(node).update(parts, _lock=threading.Lock(), _followed=lambda: True)
    node.spin()
    assert len(said) == 2


@pytest.mark.parametrize("heard", [False, True])
def test_an_agent_that_nobody_commands_registers_with_each_new_master(
    monkeypatch: pytest.MonkeyPatch, heard: bool
) -> None:
    """Whatever has failed the last time, as where it had no descriptor left."""
    failures = [OSError(errno.EMFILE, "too many open files"), RuntimeError("no thread")]
    registered: List[bool] = []

    def register_again() -> None:
        if failures:
            raise failures.pop()
        registered.append(True)

    monkeypatch.setattr(agent, "register_again", register_again)
    monkeypatch.setattr(settings, "LOOK_S", 0.02)
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    end = time.monotonic() + (0.5 if heard else 10.0)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: bool(registered) or time.monotonic() > end)
    node = agent.AgentNode.__new__(agent.AgentNode)
    parts = {"_name": "pi", "_load": Mock(), "_say": Mock(), "_host": Mock()}
    conversation = Mock(is_open=lambda now: heard)
    vars(node).update(parts, _end=conversation, _lock=threading.Lock(), _followed=lambda: True)
    node.spin()
    conversation.is_open = lambda now: True  # its thread goes on
    assert bool(registered) is not heard

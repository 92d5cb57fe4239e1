"""The stop that is the last of the velocity commands."""
from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy

from shsa_rover.ros import velocity_commands
from shsa_rover.ros.velocity_commands import VelocityCommands


class Connection:
    """A connection to a consumer, which reads all that it is sent, or nothing."""

    def __init__(self, consumer: str, reads: bool) -> None:
        self.endpoint_id, self.reads = consumer, reads
        self.stat_num_msg, self.done = 7, False


class Publisher:
    """Sends to connections."""

    resolved_name = "/cmd_vel"

    def __init__(self, connections: List[Connection]) -> None:
        self.impl = SimpleNamespace(connections=connections)

    def publish(self, message: Any) -> None:
        for each in self.impl.connections:
            each.stat_num_msg += each.reads


@pytest.mark.parametrize("reads", [True, False])
def test_a_consumer_that_is_sent_no_stop_is_named(
    reads: bool, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    connections = [Connection("/motors", reads), Connection("/recorder", True)]
    monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: Publisher(connections))
    monkeypatch.setattr(velocity_commands, "STOP_S", 0.05)
    ends: List[Any] = []
    monkeypatch.setattr(rospy, "on_shutdown", ends.append)
    VelocityCommands()
    ends[0]()
    warnings = ["A stop on /cmd_vel was not sent to /motors: it does not read what it is sent."]
    assert caplog.messages == ([] if reads else warnings)

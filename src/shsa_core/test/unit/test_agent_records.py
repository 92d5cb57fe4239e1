"""What an agent that is started again knows of its predecessor."""
import subprocess
import sys
from pathlib import Path
from typing import Iterator, List

import pytest
import rospy

from shsa_core.healing.events import NodeRestarted
from shsa_core.ros import succession
from shsa_core.ros.processes.kernel import NOBODY, identity
from shsa_core.ros.processes.restarting import Restarts
from shsa_core.ros.agent.agent_records import AgentRecords


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setattr(rospy, "get_namespace", lambda: "/")
    monkeypatch.setattr(rospy, "get_param", lambda name, default: "run")


@pytest.fixture
def process() -> "Iterator[subprocess.Popen[bytes]]":
    started = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield started
    started.kill()
    started.communicate()


def taken_up(restarts: Restarts) -> List[str]:
    return [each.node for each in AgentRecords("pi").take_up(restarts)]


def test_a_node_that_was_started_again_is_known_until_it_is_stopped_or_has_ended(
    process: "subprocess.Popen[bytes]",
) -> None:
    restarts = Restarts(lambda node: None)
    assert taken_up(restarts) == []
    records = AgentRecords("pi")
    records.started(NodeRestarted(1.0, "/driver", True, identity(process.pid), NOBODY))
    records.started(NodeRestarted(1.0, "/gone", True, (process.pid, 1.0), NOBODY))
    assert taken_up(restarts) == ["/driver"] and restarts.running() == ["/driver"]
    assert list(AgentRecords("other").take_up(restarts)) == []
    heir = AgentRecords("pi")
    assert [each.with_us for each in heir.take_up(restarts)] == [True]  # written by the second
    heir.stopped("/driver")
    assert taken_up(restarts) == []


def test_what_is_of_another_boot_or_is_no_record_is_nobody_s(
    process: "subprocess.Popen[bytes]", monkeypatch: pytest.MonkeyPatch
) -> None:
    restarts = Restarts(lambda node: None)
    told = NodeRestarted(1.0, "/driver", True, identity(process.pid), NOBODY)
    with monkeypatch.context() as before:
        before.setattr(succession, "boot", lambda: "former")
        AgentRecords("pi").started(told)
    assert taken_up(restarts) == []
    path = Path(succession.record_path("agent_pi"))
    path.write_text("nonsense\n")
    path.chmod(0o600)
    assert taken_up(restarts) == []

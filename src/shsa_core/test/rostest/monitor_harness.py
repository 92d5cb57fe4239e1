"""A harness for the monitor's tests: publishers that fail on command, and their health."""
import itertools
import os
import shutil
import subprocess
import tempfile
import time
import unittest
from typing import Callable, Dict, List, Optional, Tuple

import rosgraph
import rosnode
import rospy
import yaml  # type: ignore[import]
from rosgraph_msgs.msg import Log
from shsa_msgs.msg import Failure, Health, PublisherHealth

from shsa_core.model.checks import REGISTRY
from shsa_core.model.samples import OF_VALUE
from shsa_core.ros.wire.healing import health_row_key
from shsa_testing.faulty_publisher import FaultyNode
from shsa_testing.graph import is_connected
from shsa_testing.processes import end_process, rosrun
from shsa_testing.table_copy import TableCopy
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
MARKER = "/som_version_"


def entry(topic: str, node: str, **changes: object) -> Dict[str, object]:
    """A service of one value as in a SOM; `changes` are of the service or of the value."""
    value: Dict[str, object] = {"field": "data", "range": [-5.0, 60.0], "checks": {}}
    service: Dict[str, object] = {
        "topic": topic,
        "type": "shsa_msgs/Float64Stamped",
        "node": node,
        "period": PERIOD_S,
        "provides": {"value": value},
        "checks": {},
    }
    checks: Dict[str, object] = dict(changes.pop("checks", {}))  # type: ignore[call-overload]
    for key, change in changes.items():
        (value if key in value else service)[key] = change
    for key, limit in checks.items():
        of_value = key in REGISTRY and REGISTRY[key].sample in OF_VALUE
        place = value if of_value else service
        place["checks"][key] = limit  # type: ignore[index]
    return service


class MonitorCase(unittest.TestCase):
    """Starts a monitor and publishers, sets the SOM, and collects what the monitor publishes."""

    arguments: Tuple[str, ...] = ()
    failures: List[Tuple[float, Failure]] = []
    monitor: "subprocess.Popen[bytes]"
    _health: TableCopy
    _folder: str
    _file: str
    _versions = itertools.count()

    @classmethod
    def setUpClass(cls) -> None:
        failed = rospy.Subscriber("/shsa/failures", Failure, cls._failed, tcp_nodelay=True)
        cls._health = TableCopy("/shsa/health", Health, "publishers", health_row_key)
        cls._folder = tempfile.mkdtemp()
        cls._file = os.path.join(cls._folder, "som.yaml")
        cls._write({"marker": entry(MARKER, "/nobody")})
        cls.monitor = rosrun(
            "shsa_core", "monitor", "--som", cls._file, "--pressure", "", *cls.arguments
        )
        wait_until(lambda: failed.get_num_connections() > 0, 30.0, "the monitor is up")
        wait_until(lambda: cls._health.rows, 10.0, "the monitor watches")

    @classmethod
    def tearDownClass(cls) -> None:
        end_process(cls.monitor)
        shutil.rmtree(cls._folder)

    @classmethod
    def _write(cls, services: Dict[str, object]) -> None:
        with open(cls._file, "w") as file:
            yaml.safe_dump({"services": services}, file)

    def setUp(self) -> None:
        self.processes: List[FaultyNode] = []
        self.failures.clear()

    def tearDown(self) -> None:
        """Ends the publishers, and has the monitor forget them before another test begins."""
        for process in self.processes:
            process.end()
        # The port of a dead node may be the next one's: it would be taken for it.
        named = [process.name for process in self.processes]
        rosnode.cleanup_master_blacklist(rosgraph.Master(rospy.get_name()), named)
        self.watch()

    @classmethod
    def _failed(cls, failure: Failure) -> None:
        if not failure.topic.startswith(MARKER):
            cls.failures.append((time.monotonic(), failure))

    @property
    def table(self) -> Dict[Tuple[str, str], PublisherHealth]:
        """The monitor's table, by topic and publisher."""
        return {(row.topic, row.publisher): row for row in self._health.rows.values()}

    def watch(self, *entries: Dict[str, object]) -> None:
        """Put a SOM of these services into file and parameters, and wait until it counts.

        A topic of its own, that nobody publishes, shows in the monitor's table which SOM that is.
        """
        marker = f"{MARKER}{next(self._versions)}"
        som: Dict[str, object] = {f"p{i}": each for i, each in enumerate(entries)}
        som["marker"] = entry(marker, "/nobody")
        self._write(som)
        self.som = {"services": som}
        rospy.set_param("/shsa/som", self.som)
        self.until(lambda: (marker, "") in self.table, "the SOM counts")

    def start(self, name: str, topic: str, **parameters: object) -> FaultyNode:
        """Start a publisher."""
        process = FaultyNode(name, topic, **parameters)
        self.processes.append(process)
        return process

    def start_healthy(self, name: str, topic: str, **parameters: object) -> FaultyNode:
        """Start a publisher and wait until the monitor calls it healthy."""
        process = self.start(name, topic, **parameters)
        self.until_state(topic, name, "healthy")
        return process

    def state(self, topic: str, node: str) -> Optional[str]:
        """The state of a publisher in the monitor's table."""
        row = self.table.get((topic, node))
        return str(row.state) if row else None

    def hear_log(self, said: List[str]) -> rospy.Subscriber:
        """Collect whatever the monitor logs from now on."""
        subscriber = rospy.Subscriber("/rosout", Log, lambda log: said.append(log.msg))
        is_heard = lambda: is_connected(rospy.get_name(), "/rosout", "/monitor")
        self.until(is_heard, "the monitor's log is heard")
        return subscriber

    def until(self, condition: Callable[[], bool], what: str, seconds: float = 10.0) -> None:
        """Wait for a condition; the test fails if it does not come true."""
        try:
            wait_until(condition, seconds, what)
        except AssertionError as error:
            rows = {key: (row.state, row.kind) for key, row in self.table.items()}
            told = [(f.publisher, f.kind) for _, f in self.failures]
            self.fail(f"{error}; table {rows}; failures {told}")

    def until_state(self, topic: str, node: str, state: str, seconds: float = 10.0) -> None:
        """Wait until a publisher has a state."""
        what = f"{node} on {topic} is {state}"
        self.until(lambda: self.state(topic, node) == state, what, seconds)

    def until_failure(self, topic: str, node: str, kind: str, seconds: float = 10.0) -> float:
        """Wait for a failure; when it was heard, in s of the monotonic clock."""

        def heard() -> List[float]:
            wanted = (topic, node, kind)
            return [at for at, f in self.failures if (f.topic, f.publisher, f.kind) == wanted]

        self.until(lambda: bool(heard()), f"{kind} of {node} on {topic}", seconds)
        return heard()[0]

    def kinds(self) -> List[Tuple[str, str]]:
        """Publisher and kind of every failure of this test."""
        return [(failure.publisher, failure.kind) for _, failure in self.failures]

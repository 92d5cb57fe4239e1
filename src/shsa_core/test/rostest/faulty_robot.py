"""A robot of nodes that fail on command, for tests of what is done about it."""
import time
import unittest
from typing import Dict, List, Tuple

from shsa_msgs.msg import Float64Stamped

from shsa_testing.faulty_publisher import FaultyNode
from shsa_testing.graph import node_process
from shsa_testing.healing import HealedRobot, TopicRecord
from shsa_testing.waiting import wait_until

FILLED_IN = 10  # messages; on a busy machine the original may be late, and is filled in for
FRAME = "body"
SOON_S = 0.15  # a bound for a busy machine, the figures are those of the benchmark


class FaultyRobot(unittest.TestCase):
    """Every test begins with all nodes up and healthy.

    `nodes`: topic and value by the name of a node.
    """

    nodes: Dict[str, Tuple[str, float]] = {}
    topics: Tuple[str, ...] = ()
    period = 0.02
    robot: HealedRobot
    records: Dict[str, TopicRecord]
    processes: List[FaultyNode]
    began: float
    incidents_before: Dict[str, int]

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot = HealedRobot()
        cls.records = {name: TopicRecord(name, Float64Stamped) for name in cls.topics}
        cls.processes = []

    @classmethod
    def tearDownClass(cls) -> None:
        for process in cls.processes:
            process.end()

    def setUp(self) -> None:
        self.began = time.monotonic()
        for node in self.nodes:
            wait_until(lambda: node_process(node) or not self.runs(node), 20.0, "it is up, or gone")
            if node_process(node) is None:
                self.start(node)
        self.robot.await_available(*self.topics, seconds=40.0)
        publish = {each.name for each in self.processes}
        self.robot.await_verified(*publish.intersection(self.nodes))
        latest = ((topic, self.robot.latest(topic)) for topic in self.topics)
        self.incidents_before = {topic: each.id for topic, each in latest if each is not None}

    def runs(self, node: str) -> bool:
        """Return true if a process runs that was started as a node: it may be coming up."""
        ours = (each.process for each in self.processes if each.name == node)
        return any(each.poll() is None for each in ours)

    def start(self, node: str) -> None:
        """Start a node as a person would."""
        topic, value = self.nodes[node]
        how = {"value": value, "frame": FRAME, "period": self.period}
        self.processes.append(FaultyNode(node, topic, **how))

    def healed(self, topic: str, node: str) -> str:
        """Wait until the substitute publishes."""
        incident = self.robot.await_state(topic, "healed")
        self.assertEqual(incident.faulty_node, node)
        self.records[topic].await_node(incident.substitute)
        newest = self.records[topic].newest
        message, frame = newest[incident.substitute], newest[node].header.frame_id
        self.assertAlmostEqual(message.data, 10.0)
        self.assertEqual(message.header.frame_id, frame)
        return str(incident.substitute)

    def gap(self, topic: str, since: float) -> float:
        """The longest time without a message on a topic, in s."""
        times = [at for at, _ in list(self.records[topic].heard) if at >= since]
        return max(after - before for before, after in zip(times, times[1:]))

    def soon(self, topic: str) -> float:
        """Return how soon is at once for a topic, as far as the machine has held up another one."""
        held_up = (self.gap(each, self.began) for each in self.topics if each != topic)
        return max(SOON_S, 3 * min(held_up, default=0.0))

    def returns(self, topic: str, node: str, substitute: str) -> None:
        """Wait until the original publishes: from then on it is the only one."""
        self.robot.await_state(topic, "ended", 30.0)
        self.records[topic].await_node(node)
        published = [at for at in self.records[topic].times(substitute) if at > self.began]
        heard = [at for at in self.records[topic].times(node) if at > self.began]
        # Its longest silence: before that a hot substitute may have filled in for a late message.
        _, first = max(zip(heard, heard[1:]), key=lambda pair: pair[1] - pair[0])
        late = [at for at in published if at > first + self.soon(topic)]
        self.assertLess(len(late), FILLED_IN, f"two publishers on {topic}")

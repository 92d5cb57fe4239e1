"""A robot of plain `rostopic pub` topics, for tests of healing alone."""
import math
import subprocess
import unittest
from typing import Dict, List

from shsa_msgs.msg import Incident
from std_msgs.msg import Float64

from shsa_testing.graph import node_process
from shsa_testing.healing import HealedRobot, TopicRecord
from shsa_testing.processes import end_process
from shsa_testing.waiting import wait_until

TOPICS = {
    "/voltage_sensor": ("/voltage", 12.0),
    "/current_sensor": ("/current", 2.0),
    "/power_meter": ("/power", 24.0),
    "/thermometer": ("/temperature", 341.0),
}


class PlainRobot(unittest.TestCase):
    """Every test begins with all four publishers up and healthy, and no incident open."""

    robot: HealedRobot
    records: Dict[str, TopicRecord]
    processes: Dict[str, List["subprocess.Popen[bytes]"]]

    def incident(self, topic: str) -> Incident:
        """The newest incident of a topic."""
        newest = self.robot.latest(topic)
        self.assertIsNotNone(newest)
        return newest

    @classmethod
    def setUpClass(cls) -> None:
        cls.robot = HealedRobot()
        cls.records = {topic: TopicRecord(topic, Float64) for topic, _ in TOPICS.values()}
        cls.processes = {}

    @classmethod
    def tearDownClass(cls) -> None:
        for processes in cls.processes.values():
            for process in processes:
                end_process(process)

    def setUp(self) -> None:
        for node in TOPICS:
            ours = self.processes.get(node, [])
            ended = lambda: all(each.poll() is not None for each in ours)
            wait_until(lambda: node_process(node) or ended(), 20.0, "it is up, or gone")
            if node_process(node) is None:
                self.start(node)
        self.robot.await_available(*self.records, seconds=40.0)
        wait_until(lambda: not self.robot.substitutions, 10.0, "peace")

    def start(self, node: str, value: float = float("nan")) -> "subprocess.Popen[bytes]":
        """Start a publisher as a person would: `rostopic pub -r 20`."""
        topic, usual = TOPICS[node]
        text = {math.inf: ".inf"}.get(value, str(usual if math.isnan(value) else value))
        command = ["rostopic", "pub", "-r", "20", topic, "std_msgs/Float64", text]
        process = subprocess.Popen([*command, f"__name:={node[1:]}"], stdout=subprocess.DEVNULL)
        self.processes.setdefault(node, []).append(process)
        return process

    def value(self, topic: str) -> float:
        """The next value on a topic."""
        record = self.records[topic]
        count = len(record.heard)
        wait_until(lambda: len(record.heard) > count, 10.0, f"a message on {topic}")
        return float(record.last.data)

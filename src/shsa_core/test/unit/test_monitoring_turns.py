"""Angles have no first and no last value: what turns through pi, or stands there, is well."""
from math import pi, remainder, sin, tau
from pathlib import Path
from typing import Callable

from monitor_bench import Bench, service, with_value_checks
from witness_robot import PERIOD, Robot

from shsa_core.files.som_file import read_som
from shsa_core.model.checks import LEARNED, Witness, default_checks
from shsa_core.model.error import Error
from shsa_core.model.service import Provision, Service
from shsa_core.monitoring.events import Message, Tick
from shsa_testing.models import ontology_in

FIELD = "yaw(pose.pose.orientation)"
ONTOLOGY = """
properties: {yaw: {unit: rad}, yaw_imu: {unit: rad}, yaw_map: {unit: rad}}
relations:
  imu: {yaw: yaw_imu}
  map: {yaw: yaw_map}
"""
SOM = f"""
services:
  odometry:
    topic: /odom
    type: nav_msgs/Odometry
    node: /drivetrain
    period: 0.02
    provides:
      yaw: {{field: {FIELD}, checks: {{jump: 0.5}}}}
      x: {{field: pose.pose.position.x, checks: {{jump: 0.5}}}}
"""


def compass(name: str, *checks: Witness) -> Service:
    value = Provision(name, FIELD, checks=(*default_checks(True), *checks), error=Error(0.02))
    return Service(name, f"/{name}", "nav_msgs/Odometry", f"/{name}_node", PERIOD, (value,))


class Turner(Robot):
    """A yaw and two others, which may have another zero."""

    def __init__(self, folder: Path, limit: float, zero: float) -> None:
        compasses = compass("yaw", Witness(limit)), compass("yaw_imu"), compass("yaw_map")
        super().__init__(ontology_in(folder, ONTOLOGY), *compasses)
        self.zeros = {"yaw": 0.0, "yaw_imu": zero, "yaw_map": zero}

    def turn(self, seconds: float, true: Callable[[float], float], noise: float = 0.01) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            for each in self.services:
                yaw = true(self.now) + self.zeros[each.name] + self.random.gauss(0.0, noise)
                self.hear(Message(self.now, each.topic, each.node, (remainder(yaw, tau),)))
            self.hear(Tick(self.now))


def test_two_witnesses_convict_no_yaw_that_stands_near_pi(tmp_path: Path) -> None:
    robot = Turner(tmp_path, 0.3, 0.05)
    robot.turn(10.0, lambda _: 0.0)
    robot.turn(10.0, lambda _: pi - 0.02, 0.005)
    assert robot.failures == []
    robot.zeros["yaw"] = 0.5
    robot.turn(5.0, lambda _: pi - 0.02, 0.005)
    assert robot.kinds() == {"yaw": "witness"}


def test_nor_where_the_others_have_another_zero(tmp_path: Path) -> None:
    robot = Turner(tmp_path, LEARNED, -2.0)
    robot.turn(200.0, lambda time: 1.0 + 0.5 * sin(time))
    robot.turn(10.0, lambda _: -2.5)
    assert robot.failures == []


def test_a_turn_through_pi_is_no_jump(tmp_path: Path) -> None:
    som = tmp_path / "som.yaml"
    som.write_text(SOM)
    ((yaw, _),) = (each.provides for each in read_som(str(som)))
    bench = Bench(service(with_value_checks(*yaw.checks, field=FIELD, range=None)))
    bench.connect()
    for step in range(700):
        bench.stream(1, value=remainder(0.01 * step, tau))
    assert bench.failures == []
    bench.stream(3, value=0.0)
    assert [kind for _, kind in bench.kinds()] == ["jump"]

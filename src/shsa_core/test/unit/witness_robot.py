"""A robot of four sensors with noise, of which relations tell: a monitor with witnesses."""
from random import Random
from typing import Any, Dict, List, Optional

from shsa_core.model.calibration import CalibrationRow, CalibrationsChanged
from shsa_core.model.checks import Witness, default_checks
from shsa_core.model.health import PublisherHealth
from shsa_core.model.log import Log
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import Connected, Message, SomChanged, Tick
from shsa_core.monitoring.machine import Monitor
from shsa_testing.failures import failures_in

PERIOD = 0.02
ONTOLOGY = """
properties: {power: {}, voltage: {}, current: {}, draw: {}}
relations:
  power: {current: power / voltage, voltage: power / current, power: voltage * current}
  draw: {current: 2 * draw}
"""


def service(name: str, limit: Optional[float] = None) -> Service:
    checks = default_checks(True) + (() if limit is None else (Witness(limit),))
    value = Provision(name, "data", (0.0, 1000.0), checks=checks)
    return Service(name, f"/{name}", "std_msgs/Float64", f"/{name}_node", PERIOD, (value,))


class Robot:
    """Four sensors with noise, and what is added to each."""

    def __init__(self, ontology: Ontology, *services: Service) -> None:
        self.core, self.now = Monitor(ontology=ontology), 100.0
        self.random, self.services = Random(1), services
        self.true = {"power": 120.0, "voltage": 12.0, "current": 10.0, "draw": 5.0}
        self.failures: List[PublisherHealth] = []
        self.told: List[str] = []
        self.calibrated: List[CalibrationRow] = []
        self.hear(SomChanged(self.now, Som(services)))
        for each in services:
            self.hear(Connected(self.now, each.topic, each.node))

    def hear(self, event: Any) -> None:
        said = self.core.handle(event)
        self.failures += failures_in(said)
        changed = (each for each in said if isinstance(each, CalibrationsChanged))
        self.calibrated += [row for each in changed for row in each.rows]
        self.told += [each.text for each in said if isinstance(each, Log)]

    def run(self, seconds: float, silent: str = "", **wrong: float) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            for each in self.services:
                if each.name != silent:
                    value = self.true[each.name] * self.random.gauss(1.0, 0.01)
                    value = wrong.get(each.name, value) * self.random.gauss(1.0, 0.001)
                    self.hear(Message(self.now, each.topic, each.node, (value,)))
            self.hear(Tick(self.now))

    def kinds(self) -> Dict[str, str]:
        return {each.service: str(each.kind) for each in self.failures}


def usual() -> List[Service]:
    return [service("current", 2.0), service("power"), service("voltage"), service("draw")]

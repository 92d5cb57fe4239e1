"""A monitor's core on the bench: time is moved by hand, messages and connections are made up."""
from typing import Dict, List, Optional, Tuple

from shsa_core.monitoring.events import (
    Connected,
    Disconnected,
    FailureDetected,
    HealthChanged,
    HealthEvent,
    Message,
    SomChanged,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.machine import HealthMonitor, Settings
from shsa_core.model.som import Service, Som

TOPIC, NODE = "/battery_current", "/amperemeter"
PERIOD = 0.02
DEADLINE = 5 * PERIOD


def service(**changes: object) -> Service:
    values: Dict = dict(
        property="battery_current",
        topic=TOPIC,
        field="data",
        type="shsa_msgs/Float64Stamped",
        node=NODE,
        period=PERIOD,
        range=(-5.0, 60.0),
    )
    values.update(changes)
    return Service(**values)


class Bench:
    """A monitor whose time is moved by hand; collects every failure."""

    def __init__(self, *services: Service, settings: Settings = Settings()) -> None:
        self.core = HealthMonitor(settings)
        self.now = 100.0
        self.failures: List[FailureDetected] = []
        self.tables: List[HealthChanged] = []
        self.send(SomChanged(self.now, Som(services or (service(),))))

    def send(self, event: HealthEvent) -> None:
        for output in self.core.handle(event):
            if isinstance(output, FailureDetected):
                self.failures.append(output)
            else:
                self.tables.append(output)

    def connect(self, node: str = NODE, topic: str = TOPIC) -> None:
        self.send(Connected(self.now, topic, node))

    def disconnect(self, node: str = NODE, topic: str = TOPIC) -> None:
        self.send(Disconnected(self.now, topic, node))

    def message(
        self, value: float = 1.0, node: str = NODE, topic: str = TOPIC, age: Optional[float] = None
    ) -> None:
        self.send(Message(self.now, topic, node, (value,), age=age))

    def stream(
        self,
        count: int,
        node: str = NODE,
        value: float = 1.0,
        topic: str = TOPIC,
        period: float = PERIOD,
        age: Optional[float] = None,
    ) -> None:
        """`count` messages at a period in s, and the ticks that fall due between them."""
        for _ in range(count):
            self.wait(period)
            self.message(value, node, topic, age)

    def wait(self, seconds: float) -> None:
        """Let time pass; the monitor wakes at each of its deadlines."""
        end = self.now + seconds
        while self.core.next_deadline <= end:
            self.now = max(self.now, self.core.next_deadline)
            self.send(Tick(self.now))
        self.now = end

    def substitutes(self, *rows: Tuple[str, bool], topic: str = TOPIC) -> None:
        speaking = tuple(((topic, node), speaks) for node, speaks in rows)
        self.send(SubstitutionsChanged(self.now, speaking))

    def state(self, node: str = NODE, topic: str = TOPIC) -> Optional[str]:
        for row in self.core.table():
            if (row.topic, row.publisher) == (topic, node):
                return row.state
        return None

    def kinds(self) -> List[Tuple[str, str]]:
        return [(f.publisher, f.kind) for f in self.failures]

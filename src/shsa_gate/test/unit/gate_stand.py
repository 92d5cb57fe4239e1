"""A gate's core on the bench: time is moved by hand, messages and a table are made up."""
from typing import Any, List, Tuple

from shsa_core.model.checks import default_checks
from shsa_core.model.service import Provision, Service, Signal
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import Message, SubstitutionsChanged
from shsa_gate.events import Arrived, Log, Pass, Tick
from shsa_gate.machine import Gate

NODE, PERIOD = "/amperemeter", 0.02
RAW, HEARD = "/battery_current/raw", "/battery_current"
SUBSTITUTE, FIRST = "/substitute_battery_current_1", "/gate"
LOW, HIGH = -5.0, 60.0
NS = 10**9


def provision(*checks: Any) -> Provision:
    """The amperemeter's value, with these checks."""
    return Provision("battery_current", "data", (LOW, HIGH), checks=checks)


def with_value_checks(*checks: Any) -> Provision:
    """The amperemeter's value, with these checks beside the usual ones."""
    return provision(*default_checks(of_values=True), *checks)


def row(publishing: bool) -> Substitution:
    """The row of the substitute, which always publishes at the gate."""
    outputs = (Signal(RAW, "data", "x/Y", "", PERIOD, 5 * PERIOD),)
    return Substitution(
        SUBSTITUTE, "current", (), "y=0.0", outputs, publishing=publishing, gated=True
    )


GATED = Service(
    name="current",
    topic=RAW,
    beyond_gate=HEARD,
    type="shsa_msgs/Float64Stamped",
    node=NODE,
    period=PERIOD,
    provides=(with_value_checks(),),
)


def overheard(time: float, publisher: str, stamp: int = 0) -> Arrived:
    """Somebody publishes on the topic that consumers hear."""
    return Arrived(Message(time, HEARD, publisher, stamp=stamp), b"")


class Stand:
    """A gate whose time is moved by hand; collects what consumers hear, and when."""

    def __init__(self, gated: Service = GATED, standby_for: str = "") -> None:
        self.core = Gate(gated, standby_for)
        self.time = 0.0
        self.heard: List[Tuple[float, Pass]] = []
        self.said: List[str] = []

    def feed(self, event: Any) -> List[Pass]:
        passed = []
        for command in self.core.handle(event):
            if isinstance(command, Log):
                self.said.append(command.text)
            else:
                passed.append(command)
        assert not (self.core._muted and passed), "a muted gate lets nothing pass"
        assert {each.publisher for each in passed} <= {GATED.node, *self.core._substitutes}
        self.heard += [(event.time, each) for each in passed]
        return passed

    def until(self, time: float) -> None:
        """Let time pass: the core is woken when it wants to be."""
        for _ in range(100):
            due = self.core.next_deadline
            if due > time:
                break
            self.time = max(self.time, due)
            self.feed(Tick(self.time))
        self.time = time

    def message(
        self, value: float, node: str = NODE, stamp: int = 0, waited: float = 0.0, **more: Any
    ) -> List[Pass]:
        message = Message(self.time, RAW, node, (value,), waited=waited, stamp=stamp)
        return self.feed(Arrived(message, f"{value} {node}".encode(), **more))

    def substitute(self, publishing: bool = False, gone: bool = False) -> None:
        """The table says what the substitute does."""
        rows = () if gone else (row(publishing),)
        removed = (SUBSTITUTE,) if gone else ()
        self.feed(SubstitutionsChanged(self.time, rows, removed))

    def values(self) -> List[float]:
        return [float(each.data.split()[0]) for _, each in self.heard]

    def gap(self, since: float = 0.0) -> float:
        times = [at for at, _ in self.heard if at >= since]
        return max(later - at for at, later in zip(times, times[1:]))

    def run(
        self, count: int, original: Any = 1.0, substitute: Any = 2.0, phase: float = 0.4
    ) -> None:
        """Some periods; None: says nothing. A list: one value a period."""
        for i in range(count):
            begin = self.time
            for at, node, values in ((0.0, NODE, original), (phase, SUBSTITUTE, substitute)):
                value = values[i] if isinstance(values, list) else values
                self.until(begin + at * PERIOD)
                if value is not None:
                    self.message(value, node)
            self.until(begin + PERIOD)

"""Drives a substitute's core through made-up time, and holds its invariants after every event."""
from typing import Any, FrozenSet, List, Optional, Sequence, Tuple, Type

from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.substitution import events
from shsa_core.substitution.machine import Substitute
from shsa_core.substitution.voice import Voice

PERIOD = 0.02
DEADLINE = 0.25
CODE = "t0=x[0];y=t0"
NAME = "/substitute_1"


def signal(
    topic: str,
    period: Optional[float] = PERIOD,
    deadline: Optional[float] = DEADLINE,
    node: str = "",
    field: str = "data",
    type: str = "std_msgs/Float64",
) -> Signal:
    """A value on a topic."""
    return Signal(topic, field, type, node, period, deadline)


IN, OUT = signal("/in"), signal("/out")


def row(
    publishing: bool = False,
    inputs: Tuple[Signal, ...] = (IN,),
    code: str = CODE,
    outputs: Tuple[Signal, ...] = (OUT,),
    original: str = "",
) -> Substitution:
    """A row of the table."""
    return Substitution(
        NAME, "out", inputs, code, outputs, publishing=publishing, original=original
    )


def idle(inputs: Tuple[Signal, ...] = (), outputs: Tuple[Signal, ...] = ()) -> Substitution:
    """The row of an idle process."""
    return Substitution(NAME, "", inputs, "", outputs)


def check(core: Substitute, said: Sequence[Any]) -> None:
    """Hold what must be so after every event, to which the core has said this."""
    job, now, handover = core._job, core._now, core._handover
    published = [each for each in said if isinstance(each, events.Publish)]
    looked = any(isinstance(each, events.LookAtOriginal) for each in said)
    assert len(published) <= 1
    assert core.next_deadline > now, "all that is due has been said"
    if core._voice is Voice.MUTED:
        assert not published
        assert not (handover.original or handover.served or looked), "it replaces a node, muted"
    for each in published:
        assert core._advertising.ready(each.outputs[0].topic)
        assert job is not None and not job.unstarted, "it integrates from nobody knows where"
        assert each.stamp == core._stamps._latest[job.topic]
    if job is not None:
        assert core.reads_at > now or core._values() is None, "what is due is done, if it can be"
        listens = core._readings._readings
        assert all((each.topic, each.field, each.node) in listens for each in job.inputs)
        assert job.topic in core.topics


class Driver:
    """One substitute from `start` on; `said` is every command with its time."""

    def __init__(self, start: Substitution, time: float = 0.0) -> None:
        self.core = Substitute()
        self.time = time
        self.said: List[Tuple[float, Any]] = []
        self.tell(events.RowChanged, start)

    def tell(self, event: Type[Any], *arguments: Any) -> List[Any]:
        """An event now; the commands that it calls for."""
        commands = self.core.handle(event(self.time, *arguments))
        check(self.core, commands)
        self.said += [(self.time, command) for command in commands]
        return commands

    def pass_to(self, time: float) -> List[Any]:
        """Let time pass, with every tick that is wanted; the commands meanwhile."""
        heard: List[Any] = []
        while True:
            deadline = self.core.next_deadline
            if deadline > time:
                break
            self.time = deadline
            heard += self.tell(events.Tick, self.time - self.healer_heard())
        self.time = time
        return heard

    def healer_heard(self) -> float:
        """Return when the last sign of life of the reconfigurator came."""
        return self.time

    def arrive(self, value: float, topic: str = "/in", publisher: str = "/sensor") -> List[Any]:
        """A message with one field comes."""
        return self.tell(events.InputArrived, topic, publisher, (("data", value),))

    def change(self, row: Substitution, unusable: events.Unusable = ()) -> List[Any]:
        """The row changes."""
        return self.tell(events.RowChanged, row, unusable)

    def ready(self, topic: str = "/out") -> List[Any]:
        """The topic is registered."""
        return self.tell(events.Advertised, topic)

    def served(self, commands: List[Any], *consumers: str) -> List[Any]:
        """Answer the look at the original among `commands`."""
        (look,) = only(commands, events.LookAtOriginal)
        return self.tell(events.OriginalServes, look, frozenset(consumers) if consumers else None)

    def stream(self, until: float, value: float = 1.0, topic: str = "/in") -> None:
        """The input comes once a period, and time passes."""
        while self.time < until:
            self.arrive(value, topic)
            self.pass_to(round(self.time + PERIOD, 9))

    def published(self, since: float = 0.0) -> List[Tuple[float, float]]:
        """Return when a message went out to all, or to all but some, and its first value."""
        return [
            (round(time, 6), command.values[0])
            for time, command in self.said
            if isinstance(command, events.Publish) and time >= since and not command.only
        ]


def only(commands: List[Any], kind: Type[Any]) -> List[Any]:
    """The commands of one class."""
    return [command for command in commands if isinstance(command, kind)]


def values(commands: List[Any]) -> List[Tuple[float, ...]]:
    """Return what is published."""
    return [command.values for command in only(commands, events.Publish)]


def served(commands: List[Any]) -> List[FrozenSet[str]]:
    """Return who is left out of what is published."""
    return [command.served for command in only(commands, events.Publish)]


def running(publishing: bool = False, **of: Any) -> Driver:
    """A substitute with fresh inputs on an advertised topic, at the time 0.

    Its next message is due at PERIOD.
    """
    driver = Driver(row(publishing, **of))
    for topic in dict.fromkeys(each.topic for each in driver.core.row.outputs):
        driver.ready(topic)
    for each in driver.core.row.inputs:
        driver.arrive(1.0, each.topic)
    return driver

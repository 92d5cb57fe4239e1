"""The monitor's core on the bench: time is moved by hand, messages and connections are made up."""
from dataclasses import replace
from math import inf
from typing import Any, Dict, List, Optional, Set, Tuple

from shsa_core.model.checks import Checks, default_checks
from shsa_core.model.health import Key, PublisherHealth, PublisherState
from shsa_core.model.log import Log
from shsa_core.model.service import Provision, Service, Signal
from shsa_core.model.som import Som
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import (
    ChangeRefused,
    Command,
    Connected,
    Disconnected,
    Event,
    HealthChanged,
    Interrupted,
    Message,
    SomChanged,
    Subscribed,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.machine import Monitor
from shsa_core.monitoring.publishers import NOBODY
from shsa_core.monitoring.settings import Settings

TOPIC, NODE = "/battery_current", "/amperemeter"
PERIOD = 0.02
DEADLINE = 5 * PERIOD
LOOK = 10
WALL_S = 1e5
SETTINGS = Settings(minimum_deadline=DEADLINE)


def provision(**changes: Any) -> Provision:
    values: Dict[str, Any] = dict(property="battery_current", field="data", range=(-5.0, 60.0))
    values.update(changes)
    return Provision(**values)


def service(value: Optional[Provision] = None, **changes: Any) -> Service:
    """The amperemeter, with changes; `value`: what it provides."""
    values: Dict[str, Any] = dict(
        name="current",
        topic=TOPIC,
        type="shsa_msgs/Float64Stamped",
        node=NODE,
        period=PERIOD,
        provides=(value or provision(),),
    )
    values.update(changes)
    return Service(**values)


def stamped(message: Message) -> Message:
    """A message of such an age, with the stamp that makes it so old: in us, as clocks have it."""
    if message.age is None or message.stamp:
        return message
    return replace(message, stamp=1000 * round(1e6 * (WALL_S + message.time - message.age)))


def message_checks(*checks: Any, **counts: int) -> Checks:
    """These checks of messages, and no others."""
    return Checks(each=tuple(checks), **counts)


def with_value_checks(*checks: Any, **changes: Any) -> Provision:
    """The usual value with these checks beside the usual ones."""
    return provision(checks=(*default_checks(of_values=True), *checks), **changes)


def row(node: str, publishing: bool, *topics: str, service: str = "current") -> Substitution:
    """A substitute: idle if it has no service."""
    outputs = tuple(Signal(topic, "data", "x/Y", "", PERIOD, DEADLINE) for topic in topics)
    code = "y=0.0" if service else ""
    return Substitution(node, service, (), code, outputs, publishing=publishing)


class Bench:
    """A monitor whose time is moved by hand; collects every failure.

    After each event of which it said something, and each LOOK-th of the others, its invariants
    hold, and what it said of changes adds up to its table. The robot is there, unless `alone`.
    """

    def __init__(
        self, *services: Service, settings: Settings = SETTINGS, alone: bool = False
    ) -> None:
        self.core = Monitor(settings)
        self.now = 100.0
        self._events = 0
        self.failures: List[PublisherHealth] = []
        self.changes: List[HealthChanged] = []
        self.refused: List[ChangeRefused] = []
        self.told: List[str] = []
        self.rows: Dict[Key, PublisherHealth] = {}
        self.watch(*(services or (service(),)))
        if not alone:
            self.connect("/another", "/elsewhere")

    def watch(self, *services: Service, unheard: Tuple[str, ...] = ()) -> None:
        self.send(SomChanged(self.now, Som(services)))
        for topic in dict.fromkeys(each.topic for each in services if each.topic not in unheard):
            self.send(Subscribed(self.now, topic))

    def send(self, event: Event) -> List[Command]:
        if isinstance(event, Message):
            event = stamped(event)
        commands = self.core.handle(event)
        for command in commands:
            if isinstance(command, ChangeRefused):
                self.refused.append(command)
            elif isinstance(command, Log):
                self.told.append(command.text)
            elif isinstance(command, HealthChanged):
                self.changes.append(command)
                self.failures += command.failed
                self.rows.update({each.key: each for each in command.rows})
                for key in command.removed:
                    self.rows.pop(key, None)
        self._events += 1
        if commands or self._events % LOOK == 0:
            self._check()
        return commands

    def _check(self) -> None:
        check_tables(self.core)
        # Messages are as of the row's last change.
        # Under simulated time, so is when it was.
        when = {"since": 0.0} if self.core._pace.simulated else {}
        strip = lambda each: replace(each, first_message=None, last_good=None, **when)
        now = {each.key: strip(each) for each in table(self.core)}
        assert now == {key: strip(each) for key, each in self.rows.items()}

    def connect(self, node: str = NODE, topic: str = TOPIC, uri: str = "") -> None:
        self.send(Connected(self.now, topic, node, uri))

    def disconnect(self, node: str = NODE, topic: str = TOPIC) -> None:
        self.send(Disconnected(self.now, topic, node))

    def interrupt(self, node: str = NODE, topic: str = TOPIC) -> None:
        self.send(Interrupted(self.now, topic, node))

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

    def wake(self, late: float) -> None:
        """The monitor wakes `late` s after it wanted to, and looks."""
        self.send(Tick(self.now, late))

    def substitutes(self, *rows: Tuple[str, bool], topic: str = TOPIC) -> None:
        """The whole table: nodes that have a program for `topic`, and whether they publish."""
        whole = tuple(row(node, publishing, topic) for node, publishing in rows)
        self.send(SubstitutionsChanged(self.now, whole, whole=True))

    def muted(self) -> Set[Key]:
        """Return the substitutes that stand by."""
        board, unknown = self.core._board, PublisherState.UNKNOWN
        found = (each for each in board.all() if each.state is unknown)
        return {each.key for each in found if board.may_be_silent(each)}

    def state(self, node: str = NODE, topic: str = TOPIC) -> Optional[str]:
        found = self.rows.get((topic, node))
        return str(found.state) if found else None

    def kinds(self) -> List[Tuple[str, str]]:
        return [(f.publisher, str(f.kind)) for f in self.failures]


def table(core: Monitor) -> Tuple[PublisherHealth, ...]:
    """Return the health of every publisher, as of the last event."""
    return tuple(each.row(core._board.ours) for each in core._board.all())


def check_tables(core: Monitor) -> None:
    """Fail if anything is as it must never be."""
    board = core._board
    for topic in board.topics.values():
        assert topic.services, f"{topic.name} is watched for no service"
        assert topic.publishers, f"{topic.name} has no row"
        for name, watched in topic.services.items():
            due = board.agenda.when(watched)
            told = watched.due == inf or not topic.subscribed
            assert told or due < inf, f"nobody waits for {name}"
    for publisher in board.all():
        where = f"{publisher.name or 'nobody'} on {publisher.topic.name}"
        state, watched_ = publisher.state, publisher.watched
        services = {"": publisher.topic.unknown, **publisher.topic.services}
        own = services.get(publisher.service.name) is watched_
        failed = state is PublisherState.FAILED
        assert own, f"{where} provides a service of another topic"
        assert failed == (publisher.kind is not None), f"{where} is {state} without why"
        there = publisher.connected or state is not PublisherState.HEALTHY
        assert there, f"{where} is gone, and healthy"
        assert publisher.name != NOBODY or not publisher.connected, f"{where} is connected"
        due = board.agenda.when(publisher)
        assert due <= publisher.deadline, f"nobody looks at {where} when it is due"


def streaming() -> Bench:
    """Return a bench whose amperemeter publishes well."""
    made = Bench()
    made.connect()
    made.stream(60)
    return made

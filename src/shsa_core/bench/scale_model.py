"""A discrete-event model of healing on many computers: links, monitors, reconfigurator and master.

Each computer has one link to a switch. Messages queue at the link of their computer, at that of the
monitor's, and at the monitor, whose one thread takes all that has come in turns. Failures queue at
the reconfigurator. The master serves one call at a time, and tells subscribers by three threads,
one call a subscriber at a time. Only what is measured goes in (`Costs`), and the robot (`Robot`).
Processors are not shared: what else runs on a computer is not in the model.
"""
from typing import Callable, Dict, Generator, List, NamedTuple, Optional, Set, Tuple

import numpy as np
import simpy

COALESCE_S = 0.002
"""The monitor takes what comes within this time together."""
SLICE_S = 0.005
"""For so long a thread of a Python process keeps another one of it waiting."""
PACKET_B = 1448
"""Of TCP's payload, in a packet of Ethernet."""
PREFIX_B = 4
"""Before each message of a topic: its length."""
DEADLINE_S = 0.25
FAILURE_B = 600
"""A failure on its way to the reconfigurator."""
MASTER_THREADS = 3
MASTER_SLEEP_S = 0.1
"""Between two looks of a thread of the master that had nothing to tell."""


class Flow(NamedTuple):
    """Topics of one rate in Hz; messages of so many numbers, which the monitor reads or not."""

    topics: int
    rate: float
    numbers: int
    checked: bool = True

    @property
    def messages(self) -> float:
        """Messages/s, of all topics."""
        return self.topics * self.rate


class Costs(NamedTuple):
    """Measured figures, in s; `packet` and `back` in bytes.

    Monitor: of a turn, a message, a byte, a topic each second, and a failure after another one;
    `sight`: from a death to its first failure on an idle monitor; `connect`: of a new publisher.
    `descriptors`: files that each topic takes.
    Reconfigurator: `healed` from a failure to the first message, `next_healed` for each that comes
    at the same time.
    Master: of a registration, of a look-up of a node (the monitor asks who a new publisher is), of
    a notification (`told`: until it is answered), of a row of its state.
    Link: `packet` is added to each packet, `back` goes the other way for each message.
    """

    turn: float
    message: float
    byte: float
    topic: float
    failure: float
    sight: float
    connect: float
    descriptors: float
    healed: float
    next_healed: float
    call: float
    look_up: float
    notification: float
    told: float
    state_row: float
    packet: float
    back: float


class Robot(NamedTuple):
    """A flow spread evenly over hosts, links in bytes/s and s, and where the monitors are."""

    flow: Flow
    hosts: int
    link: float
    latency: float
    a_node: int = 10
    monitor_per_host: bool = False


class Load(NamedTuple):
    """Shares of what there is, and times in s.

    `monitor`, `link`: the most loaded one's share, of all that came to it. `found`: from the death
    of a node to each failure, `silent`: from the deadline of a lost host's topic to its failure,
    `healed`: from death or loss to the first message of each substitute.
    """

    monitor: float
    link: float
    found: List[float]
    silent: List[float]
    healed: List[float]
    lost_healed: List[float]


def message_bytes(numbers: int) -> int:
    """Return a std_msgs/Float64MultiArray of so many numbers, serialised."""
    return 12 + 8 * numbers


def turns_per_s(messages: float) -> float:
    """Turns of an idle monitor for so many messages/s, evenly spread."""
    return min(messages, 1.0 / COALESCE_S)


def on_link(costs: Costs, size: int) -> float:
    """Bytes that a message of a size takes on a link."""
    whole = size + PREFIX_B
    return whole + costs.packet * (-(-whole // PACKET_B))


class Link:
    """One direction of a link: what is sent leaves in order."""

    def __init__(self, env: simpy.Environment, rate: float, latency: float) -> None:
        self.offered = 0.0
        self._env, self._rate, self._latency = env, rate, latency
        self._free = 0.0

    def send(self, size: float, arrived: Callable[[], None]) -> None:
        """Call `arrived` once so many bytes have come to the other end."""
        took = size / self._rate
        self.offered += took
        self._free = max(self._env.now, self._free) + took
        arrival = self._env.timeout(self._free + self._latency - self._env.now)
        arrival.callbacks.append(lambda _: arrived())


class Monitor:
    """One thread that takes in turns what has come; `told(key)` is called at each failure."""

    def __init__(
        self, env: simpy.Environment, costs: Costs, topics: int, told: Callable[[object], None]
    ) -> None:
        self.offered = 0.0
        self._env, self._costs, self._told = env, costs, told
        self._topics = topics
        self._inbox: List[Tuple[float, object]] = []
        self._aside = 0.0
        self._wake: Optional[simpy.Event] = None
        env.process(self._show())
        env.process(self._run())

    def message(self, size: int) -> None:
        """A message has come."""
        self._put(self._costs.message + self._costs.byte * size, None)

    def failure(self, key: object) -> None:
        """The end of a connection has come, or a deadline is over."""
        self._put(self._costs.failure, key)

    def _put(self, work: float, key: object) -> None:
        self.offered += work
        self._inbox.append((work, key))
        if self._wake is not None:
            self._wake.succeed()
            self._wake = None

    def _show(self) -> Generator[simpy.Event, None, None]:
        """Another thread shows every topic once a second."""
        while True:
            work = self._costs.topic * self._topics
            self.offered += work
            self._aside += work
            yield self._env.timeout(1.0)

    def _run(self) -> Generator[simpy.Event, None, None]:
        looked = -COALESCE_S
        while True:
            if not self._inbox:
                self._wake = self._env.event()
                yield self._wake
            yield self._env.timeout(max(0.0, looked + COALESCE_S - self._env.now))
            looked = self._env.now
            batch, self._inbox = self._inbox, []
            aside = min(self._aside, SLICE_S)
            self._aside -= aside
            self.offered += self._costs.turn
            work = self._costs.turn + aside
            for each, key in batch:
                work += each
                if key is not None:
                    yield self._env.timeout(work)
                    work = 0.0
                    self._told(key)
            yield self._env.timeout(work)


class _Network:
    """Computers around a switch; each has a link, the first has reconfigurator and master."""

    def __init__(self, env: simpy.Environment, robot: Robot) -> None:
        make = lambda: Link(env, robot.link, robot.latency / 2.0)
        self.up = [make() for _ in range(robot.hosts)]
        self.down = [make() for _ in range(robot.hosts)]

    def send(self, sender: int, receiver: int, size: float, arrived: Callable[[], None]) -> None:
        """From a computer to another one, or to itself."""
        if sender == receiver:
            arrived()
            return
        self.up[sender].send(size, lambda: self.down[receiver].send(size, arrived))


class _Run:
    """A robot at work: nodes die one after the other, and at last a computer is lost."""

    def __init__(self, robot: Robot, costs: Costs, deaths: int, seed: int) -> None:
        self.robot, self.costs = robot, costs
        self.found: Dict[object, float] = {}
        self.healed: Dict[object, float] = {}
        self._env = simpy.Environment()
        self._random = np.random.RandomState(seed)
        self._network = _Network(self._env, robot)
        self._size = message_bytes(robot.flow.numbers)
        self._on_link = on_link(costs, self._size)
        each = robot.flow.topics / robot.hosts
        watchers = robot.hosts if robot.monitor_per_host else 1
        self._monitors = [
            Monitor(
                self._env,
                costs,
                int(each * robot.hosts / watchers),
                lambda key, host=host: self._tell(host, key),  # type: ignore[misc]
            )
            for host in range(watchers)
        ]
        self._failures = simpy.Store(self._env)
        self._env.process(self._reconfigure())
        self._count = deaths
        self._deaths: List[Tuple[object, float]] = []
        self._losses: List[Tuple[object, float]] = []

    def run(self, seconds: float) -> Load:
        robot = self.robot
        for topic in range(robot.flow.topics):
            self._env.process(self._publish(topic % robot.hosts))
        self._env.process(self._kill(seconds))
        self._env.run(until=seconds)
        self._env.process(self._lose())
        links = [*self._network.up, *self._network.down]
        monitor = max(each.offered for each in self._monitors) / seconds
        link = max(each.offered for each in links) / seconds
        self._env.run(until=2.0 * seconds)
        end = self._env.now
        late = lambda told, events: [told.get(key, end) - at for key, at in events]
        return Load(
            monitor,
            link,
            late(self.found, self._deaths),
            late(self.found, self._losses),
            late(self.healed, self._deaths),
            [at + DEADLINE_S for at in late(self.healed, self._losses)],
        )

    def _watcher(self, host: int) -> int:
        return host if self.robot.monitor_per_host else 0

    def _publish(self, host: int) -> Generator[simpy.Event, None, None]:
        period, watcher = 1.0 / self.robot.flow.rate, self._watcher(host)
        monitor = self._monitors[watcher]
        arrived = lambda: monitor.message(self._size)
        yield self._env.timeout(period * self._random.random_sample())
        while True:
            self._network.send(host, watcher, self._on_link, arrived)
            if host != watcher:
                self._network.down[host].offered += self.costs.back / self.robot.link
            yield self._env.timeout(period)

    def _kill(self, seconds: float) -> Generator[simpy.Event, None, None]:
        """Nodes die, one after the other, on computers in turn."""
        for number in range(self._count):
            yield self._env.timeout(seconds / (self._count + 1))
            host = number % self.robot.hosts
            for key in range(
                min(self.robot.a_node, -(-self.robot.flow.topics // self.robot.hosts))
            ):
                self._die(host, (number, key))

    def _die(self, host: int, key: object) -> None:
        self._deaths.append((key, self._env.now))
        watcher = self._watcher(host)
        self._network.send(
            host, watcher, self.costs.packet, lambda: self._monitors[watcher].failure(key)
        )

    def _lose(self) -> Generator[simpy.Event, None, None]:
        """Yield all topics of a computer reach their deadlines, each in its turn of a period.

        One that is lost with its monitor is missed as a whole: by its agent's silence.
        """
        flow, hosts = self.robot.flow, self.robot.hosts
        topics = flow.topics // hosts
        for number in range(topics):
            key = ("lost", number)
            if self.robot.monitor_per_host:
                self._losses.append((key, self._env.now))
                self._tell(0, key)
                continue
            yield self._env.timeout(1.0 / flow.rate / topics)
            self._losses.append((key, self._env.now))
            self._monitors[0].failure(key)
        yield self._env.timeout(0.0)

    def _tell(self, host: int, key: object) -> None:
        self.found.setdefault(key, self._env.now + self.costs.sight)
        self._network.send(host, 0, FAILURE_B, lambda: self._failures.put(key))

    def _reconfigure(self) -> Generator[simpy.Event, None, None]:
        while True:
            key = yield self._failures.get()
            yield self._env.timeout(self.costs.next_healed)
            spent = self.costs.sight + self.costs.healed - self.costs.next_healed
            self.healed.setdefault(key, self._env.now + spent + self.robot.latency)


def load(robot: Robot, costs: Costs, seconds: float = 2.0, deaths: int = 8, seed: int = 1) -> Load:
    """Run the model of a robot for so many s, and as long again after a computer is lost."""
    return _Run(robot, costs, deaths, seed).run(seconds)


def burst(costs: Costs, size: int) -> List[float]:
    """Kill a node of so many topics while nothing else runs: s until each failure."""
    env = simpy.Environment()
    found: List[float] = []
    monitor = Monitor(env, costs, size, lambda _: found.append(env.now + costs.sight))
    for key in range(size):
        monitor.failure(key)
    env.run(until=60.0)
    return found


class Master:
    """The master: calls one at a time, notifications by threads, one a subscriber at a time."""

    def __init__(self, env: simpy.Environment, costs: Costs) -> None:
        self.busy = 0.0
        self._env, self._costs = env, costs
        self._server = simpy.Resource(env, capacity=1)
        self._tasks: List[Tuple[int, Callable[[], object]]] = []
        self._busy_with: Set[int] = set()
        for number in range(MASTER_THREADS):
            env.process(self._thread(number * MASTER_SLEEP_S / MASTER_THREADS))

    def look_up(self) -> Generator[simpy.Event, None, None]:
        """Ask where another node is."""
        yield from self._work(self._costs.look_up)

    def register(self, subscriber: int, heard: Callable[[], object]) -> simpy.Event:
        """Register a publisher; its subscribers are told."""
        return self._env.process(self._register(subscriber, heard))

    def _work(self, seconds: float) -> Generator[simpy.Event, None, None]:
        with self._server.request() as turn:
            yield turn
            self.busy += seconds
            yield self._env.timeout(seconds)

    def _register(
        self, subscriber: int, heard: Callable[[], object]
    ) -> Generator[simpy.Event, None, None]:
        yield from self._work(self._costs.call)
        self._tasks.append((subscriber, heard))

    def _thread(self, phase: float) -> Generator[simpy.Event, None, None]:
        yield self._env.timeout(phase)
        while True:
            free = [task for task in self._tasks if task[0] not in self._busy_with]
            if not free:
                yield self._env.timeout(MASTER_SLEEP_S)
                continue
            subscriber, heard = free[0]
            self._tasks.remove(free[0])
            self._busy_with.add(subscriber)
            yield from self._work(self._costs.notification)
            yield self._env.timeout(max(0.0, self._costs.told - self._costs.notification))
            heard()
            self._busy_with.discard(subscriber)


def introduced(costs: Costs, topics: int, monitors: int, nodes: int) -> Tuple[float, float]:
    """Yield all nodes of a robot register at once beside monitors that wait for them.

    s until the monitors are connected to all, and the master's work in s.
    """
    env = simpy.Environment()
    master = Master(env, costs)
    connecting = [simpy.Resource(env, capacity=1) for _ in range(monitors)]
    heard: List[float] = []

    def connect(monitor: int) -> Generator[simpy.Event, None, None]:
        with connecting[monitor].request() as turn:
            yield turn
            yield from master.look_up()
            yield env.timeout(costs.connect)
        heard.append(env.now)

    def node(number: int) -> Generator[simpy.Event, None, None]:
        monitor = number % monitors
        for _ in range(topics // nodes):
            yield master.register(monitor, lambda: env.process(connect(monitor)))

    for number in range(nodes):
        env.process(node(number))
    while len(heard) < topics // nodes * nodes:
        env.step()
    return heard[-1], master.busy

"""Three healthy robots in simulated time, with everything that healthy robots do beside moving.

They reverse, stand still and saturate; their nodes crash and come back, or leave and are started
again; their computer is busy for a while, so that messages come late and all at once; connections
are made anew, subscribers come and go. Monitor and reconfigurator are the real cores.
"""
import heapq
from functools import partial
from math import cos, inf, nan
from pathlib import Path
from random import Random
from typing import Callable, Dict, List, NamedTuple, Optional, Set, Tuple, Union

from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.som_file import load_som
from shsa_core.healing import events as healing
from shsa_core.analysis.duties import duties_of, subscribers_of
from shsa_core.healing.machine import Reconfigurator
from shsa_core.model.service import Service
from shsa_core.model.substitution import Substitution, row_key
from shsa_core.monitoring import events
from shsa_core.monitoring.evidence import checked_provisions, checks_header
from shsa_core.monitoring.machine import Monitor

LOOK_S = 0.05
COMING_UP_S = 1.0
"""After the first message of a node that came up: until then its absence may still be told."""
LEAST_WAITED_S = 0.01
LONGEST_HOLD_S, RUNS_S = 0.4, 0.1
"""A busy computer keeps all processes waiting, and lets them run in between. Beside 4 busy
processes on 2 cores healthy streams waited for half as long, see experiments.md."""
EPOCH_S, CLOCK_S = 1e5, 0.01
Values = Dict[str, float]


class Motion:
    """Moves a quantity between 0 (it stands), speeds both ways, and the limits of what it can."""

    def __init__(self, random: Random, most: float, lag: float) -> None:
        self._random, self._most, self._lag = random, most, lag
        self._until = self._target = self.now = self._seen = 0.0

    def at(self, time: float) -> float:
        """Return its value; times only grow."""
        if time >= self._until:
            draw, most = self._random.random(), self._most
            self._target = self._random.choice((0.0, -most, most, draw * most, -draw * most / 2))
            long = 600.0 if self._target == 0.0 and draw < 0.1 else 30.0
            self._until = time + self._random.uniform(1.0, long)
        self.now += (self._target - self.now) * min(1.0, (time - self._seen) / self._lag)
        self._seen = time
        if self._target == 0.0 and abs(self.now) < 0.01 * self._most:
            self.now = 0.0
        return self.now


def base(random: Random) -> Callable[[str, float], Values]:
    """A base: its encoders have no noise, and its commands and its scan may stand still."""
    speed, turn = Motion(random, 1.0, 0.5), Motion(random, 2.4, 0.3)
    noise = random.gauss

    def says(service: str, time: float) -> Values:
        v, w = speed.at(time), turn.at(time)
        sides = {"left_rate": (v - 0.2 * w) / 0.1, "right_rate": (v + 0.2 * w) / 0.1}
        measured = noise(w, 0.01) if service == "imu" else w
        drawn = -0.5 - 3.0 * abs(v) - abs(w) + noise(0.0, 0.1)
        return {
            "linear_velocity": max(-1.0, min(1.0, v)),
            "turn_rate": measured,
            **{name: round(rate, 2) for name, rate in sides.items()},
            "acceleration": noise(0.0, 0.15),
            "battery_voltage": round(25.0 - time / 3600.0 + 0.1 * drawn, 1),
            "battery_current": round(drawn, 1),
            "ahead": inf if turn.now > 1.0 else round(2.0 + v, 2),
            "commanded_velocity": v,
            "commanded_turn_rate": w,
        }

    return says


def arm(random: Random) -> Callable[[str, float], Values]:
    """An arm: its joints rest at their limits as well, and are read without noise."""
    rates = Motion(random, 1.0, 0.2), Motion(random, 1.5, 0.2)
    joints, seen, held = [0.0, 0.0], [0.0, 0.0], [0.04]

    def says(service: str, time: float) -> Values:
        moving = [0.0, 0.0]
        for number, rate in enumerate(rates):
            before = joints[number]
            after = before + rate.at(time) * (time - seen[number])
            joints[number], moving[number] = max(-3.1, min(3.1, after)), rate.now
            if abs(after) >= 3.1:
                moving[number] = 0.0
            seen[number] = time
        if random.random() < 0.01:
            held[0] = random.choice((0.0, 0.085, 0.03))
        return {
            "shoulder": round(joints[0], 4),
            "elbow": round(joints[1], 4),
            "shoulder_rate": moving[0],
            "elbow_rate": moving[1],
            "load": random.gauss(12.0 * cos(joints[0]), 0.2),
            "grip_width": held[0],
            "grip_force": random.choice((0.0, 40.0)),
        }

    return says


def drone(random: Random) -> Callable[[str, float], Values]:
    """A drone: on the ground its motors stand still, in the air they saturate; no fix at times."""
    climb, roll = Motion(random, 3.0, 0.5), Motion(random, 20.0, 0.05)
    height, seen = [0.0], [0.0]

    def says(service: str, time: float) -> Values:
        rising = climb.at(time)
        height[0] = max(0.0, min(120.0, height[0] + rising * (time - seen[0])))
        seen[0] = time
        flies = height[0] > 0.0
        thrust = max(0.0, min(1.0, random.gauss(0.5 + 0.2 * rising, 0.01))) if flies else 0.0
        fix = time % 400.0 > 15.0
        return {
            "thrust": thrust,
            "trim": min(1.0, 2.0 * thrust),
            "roll_rate": random.gauss(roll.at(time) if flies else 0.0, 0.02),
            "lift": random.gauss(19.6 * thrust if flies else 9.8, 0.1),
            "pressure": round(random.gauss(101325.0 - 12.0 * height[0], 3.0), 1),
            "latitude": 48.2 + round(height[0] * 1e-6, 7) if fix else nan,
            "height": round(random.gauss(height[0], 0.5), 1) if fix else nan,
            "battery_voltage": round(16.0 - time / 1200.0 % 4.0 - thrust, 2),
        }

    return says


class Kind(NamedTuple):
    """A robot: what it says, and what its nodes do beyond the SOM, as topics and services."""

    says: Callable[[Random], Callable[[str, float], Values]]
    publishes: Tuple[Tuple[str, str], ...]
    hears: Tuple[Tuple[str, str], ...]
    serves: Tuple[Tuple[str, str], ...] = ()


BASE, GRIPPER = "/robot1/base_controller", "/gripper"
GOALS = ("/gripper/command/goal", "/gripper/command/cancel")
ANSWERS = ("/gripper/command/result", "/gripper/command/status", "/gripper/command/feedback")
ROBOTS = {
    "base": Kind(base, (("/tf", BASE),), (("/robot1/cmd_vel", BASE),), (("/robot1/stop", BASE),)),
    "arm": Kind(
        arm,
        tuple((topic, GRIPPER) for topic in ANSWERS),
        tuple((topic, GRIPPER) for topic in GOALS) + (("/arm/command", "/arm_driver"),),
    ),
    "drone": Kind(drone, (), (("/drone/command", "/drone/autopilot"),)),
}


class Found(NamedTuple):
    """All that healing did to a healthy robot, in words: nothing is right."""

    kills: List[str]
    takeovers: List[str]
    incidents: List[str]


class _Node:
    """A process of the robot, from its start to its end."""

    def __init__(self, name: str) -> None:
        self.name, self.lives, self.up, self.clean = name, 0, False, False
        self.began, self.down_since = 0.0, -inf
        self.held_until = -inf
        self.next: Dict[str, float] = {}

    @property
    def uri(self) -> str:
        return f"http://robot:{self.lives}{self.name}"


class HealthyRobot:
    """A robot with monitor and reconfigurator; `messages` were judged, `restarts` happened.

    `rate`: a rosbag of it is played so fast; None: it lives. `clock`: that is told on /clock.
    """

    def __init__(
        self, name: str, files: Path, seed: int, rate: Optional[float] = None, clock: bool = True
    ) -> None:
        self.random = Random(f"{name} {seed} {rate}")
        self._simulated = clock and rate is not None
        self.now, self.messages, self.restarts = 100.0, 0, 0
        self.found = Found([], [], [])
        self._kind, self._rate = ROBOTS[name], rate
        ontology, errors = load_ontology(str(files / f"healthy_{name}.yaml"))
        self.som, more = load_som(str(files / f"healthy_{name}_som.yaml"))
        assert not errors and not more and self.som.act
        self._says = self._kind.says(self.random)
        self._read = {s.name: [p.property for p in checked_provisions(s)] for s in self.som}
        self._monitor = Monitor(ontology=ontology)
        self._healing = Reconfigurator(ontology, self.som)
        self._due: List[Tuple[float, int, Callable[[], None]]] = []
        self._count, self._waited, self._moves = 0, 0.0, 0.0
        self._busy_until = self._stalled_until = -inf
        self._looked = self._wanted = self.now
        self._paused, self._lost = (0.0, 0.0), 0.0  # a rosbag, and for how long before in all
        self._held_back: List[Callable[[], None]] = []
        self._nodes = {node: _Node(node) for node in sorted({each.node for each in self.som})}
        self._player = _Node("/play")
        self._gone: Dict[str, List[Tuple[float, float]]] = {}
        self._rows: Dict[str, Substitution] = {}
        self._running: Set[str] = set()
        self._accused: Set[int] = set()
        self._consumers = {(each.topic, "/consumer") for each in self.som}
        self._listed: List[Dict[str, Tuple[str, ...]]] = [{}, {}]
        self._heal(healing.Started(self.now))
        self._watch(events.SomChanged(self.now, self.som))
        for node in [self._player] if rate else self._nodes.values():
            self._start(node)
        self._list_graph()
        self._later(0.0, self._look)
        self._later(20.0, self._event)

    def run(self, seconds: float) -> Found:
        """Let time pass; return what healing has done so far to what is healthy."""
        end = self.now + seconds
        while self._due and self._due[0][0] <= end:
            self.now, _, work = heapq.heappop(self._due)
            work()
        self.now = end
        return self.found

    def _later(self, delay: float, work: Callable[[], None]) -> None:
        self._count += 1
        heapq.heappush(self._due, (self.now + delay, self._count, work))

    @property
    def incidents(self) -> int:
        """The number of incidents so far, those of nodes that were gone included."""
        return len(self._accused)

    # The robot

    def _start(self, node: _Node) -> None:
        """Bring a node up: it registers, then publishes."""
        node.up, node.lives, node.began = True, node.lives + 1, self.now
        if node.lives > 1:
            self.restarts += 1
            self._gone[node.name].append((node.down_since, self.now + 1.5 + COMING_UP_S))
        life = node.lives
        for service in self.som:
            if node is self._player or service.node == node.name:
                topic = service.topic
                self._later(self.random.uniform(0.02, 0.2), self._if(node, life, topic))
                first = self.random.uniform(0.2, 1.5)
                node.next[service.name] = self.now + first
                self._later(first, self._speaker(node, life, service))
        self._list_graph()

    def _if(self, node: _Node, life: int, topic: str) -> Callable[[], None]:
        def connect() -> None:
            if node.up and node.lives == life:
                self._watch(events.Connected(self.now, topic, node.name, node.uri))

        return connect

    def _speaker(self, node: _Node, life: int, service: Service) -> Callable[[], None]:
        properties, stamps = self._read[service.name], checks_header(service)
        stamped = stamps and not service.type.startswith(("std_msgs", "geometry_msgs/Twist"))
        period = service.period or 0.5
        jitter = 0.1 * period

        def speak() -> None:
            if not node.up or node.lives != life:
                return
            at = max(self.now, node.held_until, self._busy_until)
            at = max(at, self._paused[1])
            if at > self.now:  # the process does not run: its timer fires once it does
                self._later(at - self.now + self.random.uniform(0.0, 0.002), speak)
                return
            said = self._says(service.name, self._moves_at(self.now))
            values = tuple(said[name] for name in properties)
            sent = self._ros_time(self.now)
            self._deliver(service.topic, node, life, values, sent if stamped else None)
            node.next[service.name] += period / (self._rate or 1.0)
            if service.period is None:
                node.next[service.name] = self.now + self.random.expovariate(0.5)
            elif node.next[service.name] < self.now - period:
                node.next[service.name] = self.now  # rospy.Rate forgets what it missed
            due = node.next[service.name] + self.random.uniform(0.0, jitter)
            self._later(max(0.0, due - self.now), speak)

        return speak

    def _deliver(
        self, topic: str, node: _Node, life: int, values: Tuple[float, ...], sent: Optional[float]
    ) -> None:
        def hear() -> None:
            if node.lives != life or not node.up:
                return
            self.messages += 1
            age = None if sent is None else self._clock(self.now) - sent
            stamp = 0 if sent is None else round(1e9 * sent)
            waited = max(LEAST_WAITED_S, self.now - self._looked)
            self._watch(
                events.Message(self.now, topic, node.name, values, "", age, waited, stamp=stamp)
            )

        if self._stalled_until > self.now:  # what comes together waited since the look before
            self._held_back.append(hear)
        else:
            hear()

    def _moves_at(self, time: float) -> float:
        """Return the time of the robot's motion; it must not go back."""
        self._moves = max(self._moves, time)
        return self._moves

    def _clock(self, time: float) -> float:
        """Return the time by which the monitor goes."""
        recorded = self._simulated or self._rate is None
        return self._ros_time(time) if recorded else EPOCH_S + time

    def _ros_time(self, time: float) -> float:
        """Return the time that a rosbag has reached, or the computer's own."""
        began, until = self._paused
        passed = time - self._lost - max(0.0, min(time, until) - began)
        if self._rate is None:
            return EPOCH_S + passed
        return EPOCH_S + self._rate * passed // CLOCK_S * CLOCK_S

    def _end(self, node: _Node, clean: bool, down: float) -> None:
        """A node leaves in order, or dies; it is started again after a while."""
        if not node.up:
            return
        node.up, node.clean, node.down_since = False, clean, self.now
        self._gone.setdefault(node.name, []).append((self.now, inf))
        for service in self.som:
            if node is self._player or service.node == node.name:
                self._watch(events.Disconnected(self.now, service.topic, node.name))
        self._list_graph()

        def again() -> None:
            self._gone[node.name].pop()
            self._start(node)

        self._later(down, again)

    # What happens to it

    def _event(self) -> None:
        random = self.random
        happens = [self._busy, self._held, self._reconnect, self._subscribers, self._stall]
        if self._rate:
            happens = [self._stall, self._subscribers]
            happens += [self._pause] if self._simulated else []
        elif random.random() < 0.3:
            happens = [self._restart]
        random.choice(happens)()
        self._later(random.uniform(3.0, 25.0), self._event)

    def _busy(self) -> None:
        """All processes wait for a processor, some for long; the kernel says so."""
        for number in range(self.random.randint(1, 20)):
            self._later(0.4 * number, self._hold_all)

    def _hold_all(self) -> None:
        held = self.random.expovariate(12.0)
        if self.now < self._busy_until + RUNS_S:
            return
        self._busy_until = self.now + min(held, LONGEST_HOLD_S)
        self._waited += 0.5 + min(held, LONGEST_HOLD_S)

    def _held(self) -> None:
        """One node is late: a garbage collection, a slow disk, a new subscriber."""
        node = self.random.choice(list(self._nodes.values()))
        node.held_until = self.now + self.random.uniform(0.02, 0.18)

    def _stall(self) -> None:
        """The monitor does not run; what came meanwhile it reads at once."""
        self._stalled_until = self.now + self.random.choice((0.1, 0.3, 1.0, 3.0))

    def _reconnect(self) -> None:
        """A connection is lost while the node lives."""
        service = self.random.choice(list(self.som))
        node = self._nodes[service.node]
        if node.up:
            self._watch(events.Interrupted(self.now, service.topic, node.name))
            delay = self.random.uniform(0.01, 0.2)
            self._later(delay, self._if(node, node.lives, service.topic))
            node.held_until = max(node.held_until, self.now + 0.05)

    def _subscribers(self) -> None:
        """Subscribers come and go, and a topic may be left without any."""
        for service in self.som:
            pair = service.topic, self.random.choice(("/consumer", "/rviz", "/record_1"))
            self._consumers ^= {pair}
        self._list_graph()

    def _pause(self) -> None:
        """The rosbag is paused: /clock stands."""
        began, until = self._paused
        if until <= self.now:
            self._lost += until - began
            self._paused = self.now, self.now + self.random.uniform(0.5, 20.0)

    def _restart(self) -> None:
        """A node crashes under respawn, is ended by hand, or ends with its launch."""
        node = self.random.choice(list(self._nodes.values()))
        how = self.random.choice(("crash", "rosnode kill", "launch"))
        if how == "launch":
            self._watch(events.Ending(self.now, (node.name,)))
        self._end(node, how != "crash", self.random.choice((0.3, 1.0, 5.0, 30.0)))

    # What sees and heals it

    def _look(self) -> None:
        if self._stalled_until > self.now:
            self._later(self._stalled_until - self.now, self._look)
            return
        late = self._stalled_until > self.now - LOOK_S
        wanted = self._wanted if late else self.now
        held, self._held_back = self._held_back, []
        ros_time = self._clock(self.now)
        waited = (("", self._waited),)
        self._watch(events.ClockTicked(self.now, ros_time, self._simulated, waited))
        for hear in held:
            hear()
        self._watch(events.Tick(self.now, max(0.0, self.now - wanted)))
        self._looked = self.now
        due = max(self.now, min(self._monitor.next_deadline, self.now + LOOK_S))
        self._wanted = due
        self._later(max(0.001, due - self.now), self._look)
        while self._healing.plans_ahead:
            self._heal(healing.Idle(self.now))
        if self._healing.deadline <= self.now:
            self._heal(healing.Tick(self.now))

    def _watch(self, event: events.Event) -> None:
        for command in self._monitor.handle(event):
            if isinstance(command, events.HealthChanged):
                seen = healing.HealthSeen(self.now, command.rows, command.removed)
                for row in command.failed:
                    told = row.topic, row.publisher, row.kind, row.detail, row.last_good
                    assert row.kind is not None
                    failure = healing.FailureSeen(row.since, row.service, *told)  # type: ignore
                    self._later(0.002, self._healer(failure))
                self._later(0.002, self._healer(seen))
            elif isinstance(command, events.CalibrationsChanged):
                rows = healing.CalibrationsHeard(self.now, command.rows, command.removed)
                self._later(0.002, self._healer(rows))

    def _healer(self, event: healing.Event) -> Callable[[], None]:
        return lambda: self._heal(event)

    def _heal(self, event: healing.Event) -> None:
        for command in self._healing.handle(event):
            act = self._ACTS.get(type(command))
            if act is not None:
                act(self, command)

    def _answer(self, event: healing.Event, delay: float = 0.01) -> None:
        self._later(delay, self._healer(event))

    def _list_graph(self) -> None:
        """Tell healing what the master lists."""
        kind, up = self._kind, {node.name for node in self._nodes.values() if node.up}
        own = {(each.topic, each.node) for each in self.som}
        publishers = {(t, n) for t, n in {*own, *kind.publishes} if n in up}
        hears = {(t, n) for t, n in kind.hears if n in up}
        serves = frozenset((s, n) for s, n in kind.serves if n in up)
        subscribers = frozenset({*self._consumers, *hears, ("/tf", "/rviz")})
        names = self._healing.names
        now = [
            subscribers_of(self.som, subscribers),
            duties_of(self.som, names, frozenset(publishers), subscribers, serves),
        ]
        new = [
            tuple((k, b.get(k, ())) for k in sorted({*a, *b}) if a.get(k, ()) != b.get(k, ()))
            for a, b in zip(self._listed, now)
        ]
        self._listed = now
        self._answer(healing.GraphSeen(self.now + 0.05, *new), 0.05)

    def _is_well(self, name: str, time: float) -> bool:
        """Tell if a node of the robot lives, and has for a while."""
        node = self._player if name == self._player.name else self._nodes.get(name)
        if node is None or not node.up:
            return False
        return not any(began <= time <= until for began, until in self._gone.get(name, ()))

    # What healing does

    def _show_incident(self, command: healing.ShowIncident) -> None:
        incident = command.incident
        if incident.id in self._accused:
            return
        self._accused.add(incident.id)
        if self._is_well(incident.faulty_node, incident.detected):
            told = f"{incident.faulty_node} on {incident.topic}: {incident.kind}"
            self.found.incidents.append(f"{self.now - 100.0:.2f} s: {told}: {incident.evidence}")

    def _ended(self, command: Union[healing.AskToLeave, healing.EndProcess]) -> None:
        name = command.node
        node = self._nodes.get(name)
        if node is not None and node.up:
            self.found.kills.append(f"{self.now - 100.0:.2f} s: {name}")
            self._end(node, True, 1.0)
        self._answer(healing.NodeLeft(self.now, name, command.uri))

    def _find(self, command: healing.FindNode) -> None:
        node, name = self._nodes.get(command.node), command.node
        where = healing.Where.NOWHERE
        if node is not None and node.up:
            same = not command.uri or command.uri == node.uri
            where = healing.Where.HERE if same else healing.Where.ANOTHER
        elif node is not None:  # its process was learned, whatever the master says now
            where = healing.Where.DEAD
        seen = healing.NodeFound(self.now, name, where, starter="roslaunch", uri=command.uri)
        self._answer(seen)

    def _clear(self, command: healing.ClearNode) -> None:
        node = self._nodes.get(command.node)
        if node is not None and node.clean and not node.up:
            self._answer(healing.NodeUnregistered(self.now, command.node))

    def _learn(self, command: healing.LearnNode) -> None:
        node = self._nodes.get(command.node)
        self._answer(healing.NodeLearned(self.now, command.node, node is not None and node.up))

    def _start_substitute(self, command: healing.StartSubstitute) -> None:
        name = command.node
        self._running.add(name)

        def up() -> None:
            if name in self._running:
                self._heal(healing.SubstituteStarted(self.now, name))
                self._heal(healing.ProcessPulse(self.now, name, True))
                self._join(name)

        self._later(self.random.uniform(0.2, 0.6), up)

    def _join(self, name: str) -> None:
        """A substitute connects for each row that it has, and speaks while that publishes."""
        for key, row in list(self._rows.items()):
            for topic in row.topics if row.node == name and name in self._running else ():
                self._watch(events.Connected(self.now, topic, name))
                self._speak(key, name, topic)

    def _speak(self, key: str, name: str, topic: str) -> None:
        row = self._rows.get(key)
        if row is None or row.node != name or name not in self._running:
            return
        service = self.som.services[row.service]
        if row.publishing and self._stalled_until <= self.now:
            said = self._says(service.name, self._moves_at(self.now))
            values = tuple(said[each] for each in self._read[service.name])
            self._watch(events.Message(self.now, topic, name, values))
        self._later(service.period or 0.1, lambda: self._speak(key, name, topic))

    def _stop_substitute(self, command: healing.StopNode) -> None:
        name = command.node
        self._running.discard(name)
        topics = {t for row in self._rows.values() if row.node == name for t in row.topics}
        for topic in sorted(topics):
            self._watch(events.Disconnected(self.now, topic, name))
        self._answer(healing.ProcessExited(self.now, name, "status 0"))

    def _show_substitutions(self, command: healing.ShowSubstitutions) -> None:
        for row in command.rows:
            before = self._rows.get(row_key(row))
            if row.node in self._running and (before is None or before.code != row.code):
                self._later(0.02, partial(self._join, row.node))
            if row.publishing and not (before is not None and before.publishing):
                node = self.som.services[row.service].node
                if self._is_well(node, self.now):
                    what = f"{self.now - 100.0:.2f} s: {row.node} beside {node} on {row.topics}"
                    self.found.takeovers.append(what)
        for key in command.removed:
            self._rows.pop(key, None)
        self._rows.update({row_key(row): row for row in command.rows})
        rows = tuple(row for row in command.rows if row.node)
        self._watch(events.SubstitutionsChanged(self.now, rows, command.removed))

    _ACTS: Dict[type, Callable[..., None]] = {
        healing.ShowIncident: _show_incident,
        healing.AskToLeave: _ended,
        healing.EndProcess: _ended,
        healing.FindNode: _find,
        healing.ClearNode: _clear,
        healing.LearnNode: _learn,
        healing.StartSubstitute: _start_substitute,
        healing.StopNode: _stop_substitute,
        healing.ShowSubstitutions: _show_substitutions,
    }


RATES = (0.5, 2.0)
"""At which rosbags are played: more slowly and faster than they were recorded."""
LIVES = ((None, True), *((rate, clock) for clock in (True, False) for rate in RATES))
"""A robot that lives, and rosbags that are played with /clock and without."""

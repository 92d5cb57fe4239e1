"""Lines 11 and 12: bad clocks and parameters, and strangers that speak for others."""
import random
import threading
import time
from typing import Iterator, List, Sequence, Tuple

import rospy
from rosgraph_msgs.msg import Clock, Log
from shsa_msgs.msg import Failure, Health, Substitution, Substitutions

from graph import FAULTY_PUBLISHER, PATIENCE_S, Graph
from reliability.publishers import TIRELESS
from reliability.rig import NODES, STRANGER, Rig
from reliability.scoreboard import Figures, Line, Trial
from reliability.trying import each
from shsa_testing.graph import node_pid, node_process
from shsa_testing.waiting import wait_until

BAD: Tuple[Tuple[str, object], ...] = (
    ("services/a/period", "0.1s"),
    ("services/a/period", -1),
    ("services/a/period", 0),
    ("services/a/period", float("nan")),
    ("services/a/period", 1e308),
    ("services/a/period", 5e-324),
    ("services/a/period", {"a": 1}),
    ("services/a/period", [0.02]),
    ("services/a/node", "/another"),
    ("services/a/topic", "/another"),
    ("services/a/policy", "restart"),
    ("services/a/type", "unittest.__main__/x"),
    ("services/a/provides/a/field", "no_such_field"),
    ("services/a/provides/a/range", [10, -10]),
    ("services/a", []),
    ("", "nonsense"),
)
CONTENT_S = 2.0


def bad_parameter(rig: Rig, rng: random.Random) -> Figures:
    """One bad parameter: it is named and refused, nobody fails, and healing goes on."""
    key, value = rng.choice(BAD)
    name = "/shsa/som" + ("/" + key if key else "")
    said: List[str] = []
    log = rospy.Subscriber("/rosout", Log, lambda each: said.append(each.msg))
    wait_until(lambda: log.get_num_connections() >= 2, 5.0, "the log is heard")
    good = rospy.get_param("/shsa/som")
    rospy.set_param(name, value)
    named = lambda: any("/shsa/som" in text and "efused" in text for text in said)
    wait_until(named, 5.0, f"{name} = {value!r} is refused")
    log.unregister()
    rospy.set_param("/shsa/som", good)
    assert not rig.open(), f"an incident after {name} = {value!r}"
    failed = rig.kill("/first")
    rig.await_healed("/a", failed)
    rig.bring_back("/first")
    return {}


class SimulatedClock:
    """Publishes /clock at 100 Hz, from 1000 s on."""

    def __init__(self) -> None:
        self.offset, self.rate = 1000.0, 1.0
        self._clock = rospy.Publisher("/clock", Clock, queue_size=10)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.wait(0.01):
            self.offset += 0.01 * self.rate
            self._clock.publish(Clock(clock=rospy.Time.from_sec(self.offset)))

    def end(self) -> None:
        """Stop it."""
        self._ended.set()
        self._thread.join()
        self._clock.unregister()


def clock_misbehaves(rig: Rig, rng: random.Random, clock: SimulatedClock) -> Figures:
    """Let the simulated clock jump and stall: nobody fails for it, and healing goes on."""
    for deed in rng.sample(("ahead", "back", "stall", "slow"), 4):
        if deed in ("ahead", "back"):
            clock.offset += 60.0 if deed == "ahead" else -60.0
        else:
            clock.rate = 0.0 if deed == "stall" else 0.45
        rospy.rostime.wallsleep(CONTENT_S)
        clock.rate = 1.0
        assert not rig.open(), f"an incident after the clock: {deed}"
    failed = rig.kill("/first")
    rig.await_healed("/a", failed)
    rig.bring_back("/first")
    return {}


def stranger(rig: Rig, rng: random.Random) -> Figures:
    """Somebody on the master speaks for others: no innocent node is killed."""
    alive = {node: node_pid(node) for node in NODES}
    healers = {node: node_pid(node) for node in ("/monitor", "/reconfigurator")}
    rng.choice(CLAIMS)(rig, rng)
    started = time.monotonic()
    rig.healing.await_available(*NODES.values())
    while time.monotonic() - started < CONTENT_S:
        for node, pid in {**alive, **healers}.items():
            process = node_process(node)
            assert process is not None and process.pid == pid, f"{node} was killed"
        rospy.rostime.wallsleep(0.1)
    failed = rig.kill("/first")
    rig.await_healed("/a", failed)
    rig.bring_back("/first")
    return {}


def forged_failure(rig: Rig, rng: random.Random) -> None:
    """Forge a failure of a healthy node, or of a healer."""
    victim = rng.choice(["/first", "/third", "/monitor", "/reconfigurator"])
    failure = Failure(topic=NODES.get(victim, "/a"), publisher=victim, kind="silent", detail="x")
    failure.header.stamp = rospy.Time.now()
    shout("/shsa/failures", failure)


def forged_health(rig: Rig, rng: random.Random) -> None:
    """Forge an empty table of health, stamped in 2096."""
    health = Health(whole=True)
    health.header.stamp = rospy.Time(3976214400)
    shout("/shsa/health", health)


def forged_command(rig: Rig, rng: random.Random) -> None:
    """Forge a row that tells an idle process to publish."""
    idle = [row.node for row in rig.healing.substitutions if not row.service]
    row = Substitution(node=idle[0], service="a", code="y=1.0", publishing=True)
    shout("/shsa/substitutions", Substitutions(substitutions=[row]))


def shout(topic: str, message: object) -> None:
    """Publish on a topic of healing's, as a stranger."""
    publisher = rospy.Publisher(topic, type(message), queue_size=10)
    wait_until(lambda: publisher.get_num_connections() > 0, 5.0, f"{topic} is heard")
    for _ in range(5):
        publisher.publish(message)
        rospy.rostime.wallsleep(0.05)
    publisher.unregister()


def spoof(rig: Rig, rng: random.Random) -> None:
    """Publish nonsense on the topic for a while, or until healing ends it: that may be sooner."""
    name = f"{STRANGER[1:]}{rng.randrange(10**6)}"
    arguments = ["_topic:=/a", "_value:=1000.0", "_period:=0.02", f"__name:={name}"]
    begun = time.monotonic()
    process = rig.graph.python(FAULTY_PUBLISHER, *arguments)
    heard = lambda: any(each.node == "/" + name for each in rig.messages("/a", begun))
    wait_until(lambda: heard() or process.poll() is not None, PATIENCE_S, "the stranger is heard")
    rospy.rostime.wallsleep(1.0)
    process.kill()
    process.wait()


def hostile_name(rig: Rig, rng: random.Random) -> None:
    """Register a node for the topic whose name is a command."""
    mark = rig.graph.folder / "executed"
    name = rng.choice(
        [f"/x;touch {mark}", f"/$(touch {mark})", "/substitute_a_\u00b2", "/" + "9" * 5000]
    )
    master = rospy.get_master()
    master.target.registerPublisher(name, "/a", "shsa_msgs/Float64Stamped", "http://localhost:9/")
    rospy.rostime.wallsleep(1.0)
    master.target.unregisterPublisher(name, "/a", "http://localhost:9/")
    assert not mark.exists(), "a name was executed"


CLAIMS = (forged_failure, forged_health, forged_command, spoof, hostile_name)


def parameters(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    """Of four trials one is of the clock."""
    yield from each(graph, 11, [s for s in seeds if s % 4], bad_parameter, **TIRELESS)
    rospy.set_param("/use_sim_time", True)
    clock = SimulatedClock()

    def misbehave(rig: Rig, rng: random.Random) -> Figures:
        return clock_misbehaves(rig, rng, clock)

    yield from each(graph, 11, [s for s in seeds if s % 4 == 0], misbehave, **TIRELESS)
    clock.end()
    rospy.set_param("/use_sim_time", False)


def strangers(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    yield from each(graph, 12, seeds, stranger, **TIRELESS)


LINES = (
    Line(
        11,
        "clock ±60 s, stall; 16 kinds of bad parameter",
        "monitor alive, no false healing, each bad parameter named and refused",
        parameters,
        full=64,
        short=2,
    ),
    Line(
        12,
        "spoof, forged caller id, hostile names",
        "no innocent node killed, nothing executed",
        strangers,
        full=60,
        short=2,
    ),
)

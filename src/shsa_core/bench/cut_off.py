"""The link to a computer with an agent and a monitor of its own is cut, and comes up again.

/first comes from there, and is needed here; only the monitor there watches it. /near comes from
here, and is needed there; a hot substitute stands by there. Prints one JSON object: for each topic,
as its consumer hears it, the longest `gap` in s during the cut, and `overlap`, from the first
message of the original that is heard after the cut, backlog or not, to the departure of the last
one of the substitute that does not fill in for a pause of it; `near_here`, the same for the
consumer of /near on our side; `late`, messages older than 0.25 s of both, that the cut had kept
back; `after`, who publishes each topic for a second after all; `spared`: whether the originals run.
With --restart, the reconfigurator is killed during the cut. Needs the right to make namespaces.
"""
import argparse
import json
import signal
import subprocess
import sys
import time
from bisect import bisect
from collections import Counter
from pathlib import Path
from typing import Dict, List, NamedTuple, Set, Tuple

import rosgraph
import rospy
from shsa_msgs.msg import Float64Stamped

from far_graph import print_measured
from graph import FAULTY_PUBLISHER, PACKAGE, PATIENCE_S, Graph, service
from shsa_testing.computers import Computer
from shsa_testing.graph import node_process
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
LATE_S = 0.25
SETTLED_S = 3.0
QUIET_S = 1.0
HEALED_S = 60.0
ROOM = 1000
"""Cores of each computer: what else runs on this machine is to move no substitute."""
FIRST, NEAR = "/first", "/near"
ORIGINALS = {FIRST: "/first_node", NEAR: "/near_node"}
CONSUMER = """
import sys, time, rospy
from shsa_msgs.msg import Float64Stamped
def heard(message):
    age = rospy.get_time() - message.header.stamp.to_sec()
    print(time.monotonic(), message._connection_header["callerid"], age, flush=True)
rospy.init_node("consumer")
rospy.Subscriber(sys.argv[1], Float64Stamped, heard, tcp_nodelay=True, queue_size=10000)
rospy.spin()
"""
ONTOLOGY = """
properties: {source: {unit: ""}, first: {unit: ""}, far_source: {unit: ""}, near: {unit: ""}}
relations:
  one: {first: 10 * source}
  two: {near: 10 * far_source}
"""


class Heard(NamedTuple):
    """A message: when it came, from whom, and how old it was."""

    at: float
    node: str
    age: float

    @property
    def sent(self) -> float:
        """Return when it was sent."""
        return self.at - self.age


class Consumer:
    """Hears a topic on another computer."""

    def __init__(self, graph: Graph, far: Computer, topic: str) -> None:
        self._file = graph.folder / f"heard{topic.replace('/', '_')}"
        program = far.words(sys.executable, "-c", CONSUMER, topic)
        graph.start("sh", "-c", 'exec "$@" > "$0"', str(self._file), *program)

    @property
    def heard(self) -> List[Heard]:
        """Return what came so far, without a line that is still being written."""
        text = self._file.read_text() if self._file.exists() else ""
        rows = [line.split() for line in text[: text.rfind("\n") + 1].splitlines()]
        return [Heard(float(at), node, float(age)) for at, node, age in rows]


class Listener:
    """Hears a topic here."""

    def __init__(self, topic: str) -> None:
        self.heard: List[Heard] = []
        rospy.Subscriber(topic, Float64Stamped, self._took, tcp_nodelay=True, queue_size=10000)

    def _took(self, message: Float64Stamped) -> None:
        age = rospy.get_time() - message.header.stamp.to_sec()
        node = message._connection_header["callerid"]
        self.heard.append(Heard(time.monotonic(), node, age))


def models(folder: Path) -> Dict[str, str]:
    """Return the files of ontology and SOM, as arguments of the launch file."""
    ontology, som = folder / "ontology.yaml", folder / "som.yaml"
    ontology.write_text(ONTOLOGY)

    def hot(topic: str, host: str, other: str) -> Dict[str, object]:
        """Return a topic that comes from one computer, and has a substitute on the other."""
        more = {"needed": True, "standby": "hot", "placement": {"prefer": [other]}}
        return {**service(topic, ORIGINALS[topic], PERIOD_S, host=host), **more}

    services = {
        "source": service("/source", "/source_node", PERIOD_S, host="own"),
        "far_source": service("/far_source", "/far_source_node", PERIOD_S, host="far"),
        "first": hot(FIRST, "far", "own"),
        "near": hot(NEAR, "own", "far"),
    }
    room = {"cores": ROOM}
    hosts = {"own": room, "far": room}
    som.write_text(json.dumps({"act": True, "hosts": hosts, "services": services}))
    return {"ontology": str(ontology), "som": str(som), "secret": str(folder / "secret")}


def start(graph: Graph, far: Computer) -> "List[subprocess.Popen[str]]":
    """Start the robot and its healing on both computers; the processes of the originals."""
    originals = []
    python = (sys.executable, str(FAULTY_PUBLISHER))
    for computer, topic, value in (
        (None, "/source", 1.0),
        (far, "/far_source", 1.0),
        (far, FIRST, 10.0),
        (None, NEAR, 10.0),
    ):
        words = (*python, f"_topic:={topic}", f"_value:={value}", f"__name:={topic[1:]}_node")
        process = graph.start(*(far.words(*words) if computer else words))
        if topic in ORIGINALS:
            originals.append(process)
    files = models(graph.folder)
    given = [f"{name}:={file}" for name, file in files.items()]
    launch = ("roslaunch", "shsa_core", "shsa.launch", "host:=own", "monitors_on:=far")
    graph.start(*launch, "hold_off:=0.5", "startup_grace:=120", *given)
    secret = Path(files["secret"])
    wait_until(secret.exists, PATIENCE_S, "the secret")
    node = lambda name, *words: (sys.executable, str(PACKAGE / "nodes" / name), *words)
    signed = ("--secret", str(secret))
    graph.start(*far.words(*node("agent", "--name", "far", *signed)))
    graph.start(*far.words(*node("monitor", "--som", files["som"], "--host", "far", *signed)))
    return originals


def spoken_beside(heard: List[Heard], original: str) -> List[Heard]:
    """Return the messages of others that do not fill in for an original that pauses."""
    came = sorted(each.at for each in heard if each.node == original)
    others = [each for each in heard if each.node != original]
    last = lambda each: came[bisect(came, each.sent) - 1 :][:1]
    return [e for e in others if any(0.0 <= e.sent - at < PERIOD_S for at in last(e))]


def publishers(heard: List[Heard], since: float) -> Set[str]:
    """Return who goes on publishing since a moment; others fill in for what their link holds up."""
    counts = Counter(each.node for each in heard if each.at > since)
    return {node for node, count in counts.items() if count > QUIET_S / PERIOD_S / 2}


def figures(heard: List[Heard], original: str, down: float, up: float) -> Dict[str, float]:
    """Return the cut as a consumer heard it."""
    times = [down, *(each.at for each in heard if down < each.at < up), up]
    back = [each.at for each in heard if each.node == original and each.at > up]
    others = [each.sent for each in spoken_beside(heard, original) if each.at > up]
    overlap = max(others, default=0.0) - min(back) if back else -1.0
    return {
        "gap": round(max(b - a for a, b in zip(times, times[1:])), 3),
        "overlap": round(max(0.0, overlap), 3),
    }


def overheard() -> bool:
    """Return whether a substitute listens for other publishers of its topic."""
    _, subscribers, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    return any(
        "/substitute_near" in " ".join(nodes) for topic, nodes in subscribers if topic == NEAR
    )


def measure(graph: Graph, far: Computer, seconds: float, restart: bool) -> object:
    """Cut the link for so long, and look what comes of it."""
    originals = start(graph, far)
    there, here, beside = Consumer(graph, far, NEAR), Listener(FIRST), Listener(NEAR)
    healing = graph.healing
    healing.await_available(FIRST, NEAR, "/source", "/far_source", seconds=HEALED_S)
    placed = lambda: {row.service: row.host for row in healing.substitutions if row.service}
    wait_until(lambda: placed() == {"first": "", "near": "far"}, HEALED_S, "hot substitutes")
    wait_until(lambda: there.heard, PATIENCE_S, "the consumer there")
    wait_until(overheard, HEALED_S, "the substitute there listens for others")
    time.sleep(SETTLED_S)
    down = time.monotonic()
    far.link.cut()
    if restart:
        healer = node_process("/reconfigurator")
        assert healer is not None
        time.sleep(seconds / 2.0)
        healer.send_signal(signal.SIGKILL)
    wait_until(lambda: time.monotonic() > down + seconds, seconds + PATIENCE_S, "the cut")
    up = time.monotonic()
    far.link.restore()

    def settled() -> bool:
        """Return whether each consumer hears the original alone."""
        since = time.monotonic() - QUIET_S
        alone = True
        for heard, topic in ((there.heard, NEAR), (here.heard, FIRST), (beside.heard, NEAR)):
            original = ORIGINALS[topic]
            alone = alone and publishers(heard, since) == {original}
        return alone and all(not row.publishing for row in healing.substitutions)

    wait_until(settled, HEALED_S, "one publisher each")
    time.sleep(QUIET_S)
    end = time.monotonic()
    found: Dict[str, object] = {"seconds": seconds}
    after: Dict[str, List[str]] = {}
    late = 0
    consumers: Tuple[Tuple[str, List[Heard], str], ...] = (
        ("near", there.heard, NEAR),
        ("first", here.heard, FIRST),
        ("near_here", beside.heard, NEAR),
    )
    for name, heard, topic in consumers:
        found[name] = figures(heard, ORIGINALS[topic], down, up)
        after[name] = sorted(publishers(heard, end - QUIET_S))
        late += sum(each.age > LATE_S for each in heard if each.at > up)
    found.update(after=after, late=late)
    found["spared"] = all(each.poll() is None for each in originals)
    return found


def main() -> int:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="how long the link is cut")
    parser.add_argument("--restart", action="store_true", help="kill the reconfigurator meanwhile")
    options = parser.parse_args()
    print_measured(lambda graph, far: measure(graph, far, options.seconds, options.restart))
    return 0


if __name__ == "__main__":
    sys.exit(main())

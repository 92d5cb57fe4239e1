"""The robots of load.py: one of nine rospy nodes in a namespace, and the rover."""
import json
import subprocess
from pathlib import Path
from typing import Dict, List, Mapping, NamedTuple, Protocol, Sequence

from faults import FAULTS, Cause, commanded, leave
from graph import FAULTY_PUBLISHER, PACKAGE, PATIENCE_S, Graph, ask_to_leave
from shsa_testing.graph import publishers
from shsa_testing.waiting import wait_until

NAMESPACE, FRAME, LIMIT = "/bot", "bot_link", 10.0
RATES = {
    **{"hot": 50.0, "warm": 50.0, "cold": 50.0, "base": 100.0, "spare": 25.0},
    **{"gyro": 20.0, "sonar": 10.0, "door": 5.0, "lamp": 4.0},
}
"""In Hz, by the name of node and topic: the first three fail, and follow from the next two."""
STANDBY = ("hot", "warm", "cold")
RESPAWN = "respawn"
LAUNCH = """
<launch>
  <node ns="{namespace}" pkg="shsa_testing" type="faulty_publisher" name="{name}"
        args="{arguments}" respawn="true" />
</launch>
"""
CAUSES: Mapping[str, Cause] = {
    "kill -9": FAULTS["kill -9"].cause,
    "clean end": leave,
    "SIGSTOP": FAULTS["SIGSTOP"].cause,
    "wrong values": FAULTS["out of range"].cause,
    "silence": commanded("mute"),
    "babbling": commanded("period 0.0005"),
}
"""The faults; only the first three can be had of a node that takes no commands."""
OF_PROCESSES = tuple(CAUSES)[:3]
ENDED = tuple(CAUSES)[:2]
"""Those that roslaunch sees."""


class Target(NamedTuple):
    """A node that fails, its topic and service, and what stands by for it."""

    node: str
    topic: str
    service: str
    standby: str

    @property
    def healed(self) -> bool:
        """Return whether healing answers its faults."""
        return self.standby != RESPAWN


class Robot(Protocol):
    """A robot that is healed."""

    @property
    def name(self) -> str:
        """Return its name."""

    @property
    def targets(self) -> Sequence[Target]:
        """Return the nodes that fail."""

    @property
    def faults(self) -> Sequence[str]:
        """Return the names of their faults."""

    def start(self, target: Target) -> None:
        """Start a node again, as somebody would."""

    def end(self) -> None:
        """End everything."""


class NineNodes:
    """Nine rospy nodes in a namespace, and a tenth that nobody heals but roslaunch starts again."""

    name = "nine nodes"
    faults = tuple(CAUSES)

    def __init__(self, graph: Graph, *settings: str) -> None:
        self._graph = graph
        self._nodes: Dict[str, "subprocess.Popen[str]"] = {}
        self.targets = [self._target(name, name) for name in STANDBY]
        self.targets.append(self._target("respawned", RESPAWN))
        for name in RATES:
            self._nodes[name] = graph.python(FAULTY_PUBLISHER, f"__ns:={NAMESPACE}", *_words(name))
        path = graph.folder / "respawned.launch"
        arguments = " ".join(_words("respawned")[:-1])
        names = {"namespace": NAMESPACE, "name": "respawned", "arguments": arguments}
        path.write_text(LAUNCH.format(**names))
        self._launches = [graph.start("roslaunch", str(path))]
        # Two that begin at once may each give the master another run.
        wait_until(lambda: publishers(f"{NAMESPACE}/respawned"), PATIENCE_S, "the tenth node")
        words = ("roslaunch", "shsa_core", "shsa.launch", *_nine(graph.folder), *settings)
        self._launches.append(graph.start(*words))

    def _target(self, name: str, standby: str) -> Target:
        return Target(f"{NAMESPACE}/{name}", f"{NAMESPACE}/{name}", name, standby)

    def start(self, target: Target) -> None:
        """Start a node again."""
        name = target.topic.rpartition("/")[2]
        if name in self._nodes:
            self._nodes[name].kill()
            self._nodes[name].wait()
            self._nodes[name] = self._graph.python(
                FAULTY_PUBLISHER, f"__ns:={NAMESPACE}", *_words(name)
            )

    def end(self) -> None:
        """End everything."""
        for process in (*self._launches, *self._nodes.values()):
            ask_to_leave(process, 30.0)


def _words(name: str) -> Sequence[str]:
    """Return the arguments of a node of the nine."""
    period, value = 1.0 / RATES.get(name, 50.0), 1.0 if name in STANDBY else 2.0
    said = {"topic": name, "period": period, "value": value, "frame": FRAME}
    return (*(f"_{key}:={each}" for key, each in said.items()), f"__name:={name}")


def _nine(folder: Path) -> Sequence[str]:
    """Write the models of the nine nodes; return the arguments that name them."""
    laws = {f"{name}_of_base": {name: "0.5 * base"} for name in STANDBY}
    laws.update({f"{name}_of_spare": {name: "0.5 * spare"} for name in STANDBY})
    ontology = {"properties": {name: {"unit": "m"} for name in RATES}, "relations": laws}
    services: Dict[str, Dict[str, object]] = {}
    for name, rate in RATES.items():
        place = f"{NAMESPACE}/{name}"
        services[name] = {
            **{"topic": place, "node": place, "type": "shsa_msgs/Float64Stamped"},
            **{"period": 1.0 / rate, "needed": name in STANDBY},
            "provides": {name: {"field": "data", "range": [-LIMIT, LIMIT]}},
        }
        if name in STANDBY:
            services[name]["standby"] = name
    paths = folder / "nine.yaml", folder / "nine_som.yaml"
    for path, content in zip(paths, (ontology, {"act": True, "services": services})):
        path.write_text(json.dumps(content))
    return f"ontology:={paths[0]}", f"som:={paths[1]}"


class Rover:
    """The simulated rover; its amperemeter fails."""

    name = "rover"
    faults = OF_PROCESSES

    def __init__(self, graph: Graph, standby: str, *settings: str) -> None:
        self._graph = graph
        self.targets = [Target("/amperemeter", "/battery_current", "amperemeter", standby)]
        package = PACKAGE.parent / "shsa_rover"
        som = (package / "ontology" / "rover_som.yaml").read_text()
        path = graph.folder / f"rover_{standby}.yaml"
        path.write_text(som.replace("standby: warm", f"standby: {standby}", 1))  # its first service
        self._again: List["subprocess.Popen[str]"] = []
        words = ("roslaunch", "shsa_rover", "rover.launch", f"som:={path}", *settings)
        self._launch = graph.start(*words)

    def start(self, target: Target) -> None:
        """Start a node again; the master has its parameters."""
        self._stop()
        self._again.append(self._graph.start("rosrun", "shsa_rover", target.node.strip("/")))

    def _stop(self) -> None:
        while self._again:
            process = self._again.pop()
            process.kill()
            process.wait()

    def end(self) -> None:
        """End everything."""
        self._stop()
        ask_to_leave(self._launch, 30.0)

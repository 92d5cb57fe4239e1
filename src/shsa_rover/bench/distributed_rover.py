"""The rover on three computers made of namespaces, healed; a consumer listens on the mainboard.

Master and healing are on the notebook, an agent is on each other computer. Their nodes are started
there as at boot, so that a computer that was powered off can come back. The simulated world is on
none of them.
"""
import contextlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Dict, Iterator, List, NamedTuple

import psutil
import rosgraph
import rospkg
import rospy
import yaml  # type: ignore[import]
from shsa_msgs.msg import Incident

from shsa_core.ros.trust import secret
from shsa_testing.computers import Computer, Computers
from shsa_testing.graph import publishers
from shsa_testing.healing import HealedRobot, moment_of
from shsa_testing.link import Link
from shsa_testing.waiting import wait_until

PI, MAINBOARD, NOTEBOOK = NAMES = ("raspberry_pi", "mainboard", "notebook")
TOPIC, NODE = "/battery_current", "/amperemeter"
NODES = (NODE, "/imu")
"""On the Raspberry Pi."""
TOPICS = (TOPIC, "/battery_voltage", "/odom", "/drivetrain/accel", "/imu/data", "/cmd_vel")
HOLD_OFF_S = 0.5
RELAPSE_S = 5.0 * HOLD_OFF_S + 1.0
"""An original that fails sooner after its return has relapsed: no two failures are so near."""
PATIENCE_S = 120.0
"""A way back over a bad link takes up to a minute."""
CONSUMER = Path(__file__).with_name("hosts_consumer.py")


class Heard(NamedTuple):
    """A message as the consumer heard it: when, whose, its number, and its age in s."""

    at: float
    node: str
    number: int
    age: float


class DistributedRover:
    """The rover, its amperemeter's substitute at hand as `standby` says."""

    def __init__(self, network: Computers, standby: str) -> None:
        self.network = network
        self.heard: List[Heard] = []
        self._output = network.folder / "output"
        self._started: Dict[str, List["subprocess.Popen[bytes]"]] = {name: [] for name in NAMES}
        self._port = network.folder / "uart"
        self._som = _som(network.folder, standby)
        self._share_secret()
        self._boot(NOTEBOOK)
        wait_until(rosgraph.is_master_online, PATIENCE_S, "the master")
        rospy.init_node("bench_hosts", anonymous=True, disable_signals=True)
        self.healing = HealedRobot()
        self._steps: List[Incident] = []
        rospy.Subscriber("/shsa/incidents", Incident, self._steps.append)
        self._world = self._simulate()
        for name in (MAINBOARD, PI):
            self._boot(name)
        self._consumer = subprocess.Popen(
            self.network[MAINBOARD].words(sys.executable, str(CONSUMER), **self._master()),
            stdout=subprocess.PIPE,
        )
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def link(self) -> Link:
        """The Raspberry Pi's."""
        return self.network[PI].link

    def await_well(self) -> None:
        """Wait until everything runs, and no failure is near. Raises AssertionError."""
        self.healing.await_available(*TOPICS, seconds=PATIENCE_S)
        self.healing.await_verified(NODE, seconds=PATIENCE_S)
        open_ = lambda: [e for e in self.healing.incidents.values() if e.state != Incident.ENDED]
        wait_until(lambda: not open_(), PATIENCE_S, "all incidents have ended")
        at_hand = lambda: set(publishers(TOPIC)) - {NODE}
        wait_until(at_hand, PATIENCE_S, "a substitute is at hand, and has advertised the topic")
        returned = moment_of(self._incident().returned) if self.latest() else 0.0
        calm = lambda: time.monotonic() > returned + RELAPSE_S and self.speakers(1.0) == [NODE]
        wait_until(calm, PATIENCE_S, "the amperemeter alone publishes for a while")

    def latest(self) -> int:
        """Return the number of the topic's newest incident; 0: there was none."""
        incident = self.healing.latest(TOPIC)
        return 0 if incident is None else int(incident.id)

    def incidents(self, since: int) -> List[Incident]:
        """Return the topic's incidents after one, as they are now."""
        found = list(self.healing.incidents.values())
        return sorted(
            (each for each in found if each.topic == TOPIC and each.id > since),
            key=lambda each: int(each.id),
        )

    def steps(self, since: int) -> List[Incident]:
        """Return the steps of the topic's incidents after one, in order."""
        return [each for each in list(self._steps) if each.topic == TOPIC and each.id > since]

    def await_healed(self, since: int) -> None:
        """Wait until a newer incident is healed. Raises AssertionError."""
        healed = lambda: any(each.state == Incident.HEALED for each in self.incidents(since))
        wait_until(healed, PATIENCE_S, "the topic is healed")

    def speakers(self, seconds: float) -> List[str]:
        """Return the publishers of the last seconds."""
        since = time.monotonic() - seconds
        return sorted({each.node for each in self.since(since)})

    def since(self, moment: float) -> List[Heard]:
        """Return what was heard since a moment."""
        return [each for each in list(self.heard) if each.at >= moment]

    def kill_amperemeter(self) -> None:
        """`kill -9`."""
        _processes(self.network[PI], NODE)[0].kill()

    def revive(self) -> List[str]:
        """Start the Raspberry Pi's nodes that do not run, as a person would; who they are."""
        ended = [node for node in NODES if not _processes(self.network[PI], node)]
        for node in ended:
            self._run(PI, "rosrun", "shsa_rover", node[1:], f"__name:={node[1:]}")
        return ended

    def power_off(self) -> None:
        """The Raspberry Pi: all its processes and its link at once."""
        self.network[PI].power_off()
        for each in self._started[PI]:
            each.wait()
        self._started[PI].clear()

    def power_on(self) -> None:
        """The Raspberry Pi boots."""
        self.network[PI].power_on()
        self._boot(PI)

    def end(self) -> None:
        """Stop what needs the master; the rest goes with the computers."""
        rospy.signal_shutdown("the benchmark ends")
        for each in [
            self._consumer,
            self._world,
            *(p for name in NAMES for p in self._started[name]),
        ]:
            each.kill()
            each.wait()

    def last_words(self, lines: int = 40) -> str:
        """Return the end of what the nodes said."""
        return "\n".join(self._output.read_text(errors="replace").splitlines()[-lines:])

    def _incident(self) -> Incident:
        return self.healing.latest(TOPIC) or Incident()

    def _boot(self, name: str) -> None:
        groups = [f"{each}:={str(each == name).lower()}" for each in NAMES]
        lines = ("voltage", "base", "imu")
        ports = [f"port:={self._port}", *(f"{each}_port:={self._port}_{each}" for each in lines)]
        world = f"sim:={str(name != MAINBOARD).lower()}"
        healing = f"host:={NOTEBOOK}", f"som:={self._som}", f"hold_off:={HOLD_OFF_S}"
        self._run(name, "roslaunch", "shsa_rover", "rover.launch", *groups, *ports, world, *healing)
        if name != NOTEBOOK:
            self._run(
                name, "roslaunch", "shsa_core", "agent.launch", f"name:={name}", "wall_time:=true"
            )

    def _simulate(self) -> "subprocess.Popen[bytes]":
        """Start the world, which goes on whatever happens to a computer: it is on none of them."""
        command = ("rosrun", "shsa_rover", "rover_simulator", f"_port:={self._port}")
        with open(str(self._output), "ab") as file:
            return subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)

    def _run(self, name: str, *words: str) -> None:
        with open(str(self._output), "ab") as file:
            process = subprocess.Popen(
                self.network[name].words(*words, **self._master()),
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
            )
        self._started[name].append(process)

    def _master(self) -> Dict[str, str]:
        return {"ROS_MASTER_URI": f"http://{self.network[NOTEBOOK].address}:11311"}

    def _share_secret(self) -> None:
        """One secret of healing on all of them, as hosts_setup copies it."""
        paths = [each.home / ".ros" / "shsa" / "secret" for each in self.network]
        text = os.urandom(secret.LENGTH_B)
        for path in paths:
            path.parent.mkdir(parents=True)
            path.touch(0o600)
            path.write_bytes(text)

    def _listen(self) -> None:
        assert self._consumer.stdout is not None
        for line in self._consumer.stdout:
            at, node, number, age = line.decode().split()
            self.heard.append(Heard(float(at), node, int(number), float(age)))


@contextlib.contextmanager
def distributed_rover(standby: str) -> Iterator[DistributedRover]:
    """Return the rover while it is needed."""
    before = {name: os.environ.get(name) for name in ("ROS_IP", "ROS_MASTER_URI")}
    with Computers(*NAMES) as network:
        os.environ["ROS_IP"] = network.here
        os.environ["ROS_MASTER_URI"] = f"http://{network[NOTEBOOK].address}:11311"
        rover = DistributedRover(network, standby)
        try:
            yield rover
        finally:
            rover.end()
            for name, value in before.items():
                os.environ.pop(name, None)
                os.environ.update({} if value is None else {name: value})


def _som(folder: Path, standby: str) -> Path:
    """Return the rover's SOM with another standby of the amperemeter."""
    source = Path(rospkg.RosPack().get_path("shsa_rover")) / "ontology" / "rover_hosts_som.yaml"
    som = yaml.safe_load(source.read_text())
    som["services"][NODE[1:]]["standby"] = standby
    path = folder / "som.yaml"
    path.write_text(yaml.safe_dump(som))
    return path


def _processes(computer: Computer, node: str) -> List[psutil.Process]:
    """Return the processes of a node on a computer, without those that start it."""
    found = {each: _words(each) for each in computer.processes()}
    started = lambda words: "rosrun" in " ".join(words)
    return [
        p for p, words in found.items() if f"__name:={node[1:]}" in words and not started(words)
    ]


def _words(process: psutil.Process) -> List[str]:
    """Return the command of a process; none if it has ended by now."""
    try:
        return list(process.cmdline())
    except psutil.NoSuchProcess:
        return []

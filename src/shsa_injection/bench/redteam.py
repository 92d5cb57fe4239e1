"""Attacks a live robot as another user of its computer: what it costs, and whom it ends.

Each attack has a robot of its own. A real failure comes in its midst. Exit status 1 if a process
ends that was not accused, code runs, a healer is not there any more, the failure is healed in more
than twice its usual time, or a healer takes more than it may. Needs root, to be three users.
"""
import argparse
import base64
import csv
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Dict, List, NamedTuple, Optional, Sequence, Set, Tuple

import psutil
import rospy
from shsa_msgs.msg import Float64Stamped
from tabulate import tabulate
from tqdm import tqdm

from graph import Graph, PACKAGE
from shsa_testing.healing import TopicRecord
from shsa_testing.graph import node_pid, node_process
from shsa_testing.processes import running
from shsa_testing.waiting import wait_until

from redteam_attacks import ATTACKS
from redteam_attacks.target import GATE

ROBOT, STRANGER = 4001, 4002
DATA = PACKAGE / "test" / "data"
NODES = {"source": 1.0, "spare": 1.0, "hot": 10.0, "warm": 10.0, "cold": 10.0, "again": 10.0}
MORE = """\
  gated:
    topic: /gated
    gate: /gated/raw
    type: shsa_msgs/Float64Stamped
    node: /gated_node
    period: 0.02
    needed: false
    provides:
      by_gated: {field: data, range: [0, 100]}
  again:
    topic: /again
    type: shsa_msgs/Float64Stamped
    node: /again_node
    period: 0.02
    needed: true
    policy: restart
    provides:
      by_again: {field: data, range: [0, 100]}
"""
PROPERTIES = 'properties:\n  by_again: {unit: ""}\n  by_gated: {unit: ""}\n'
GATED = 5.0
ATTACKED = "warm", "again"
"""Nodes that fail, or whose names are taken: the master itself ends who had the name before."""
HEALERS = "/monitor", "/reconfigurator", GATE
MOST_MEMORY_MB, MOST_PROCESSOR, MOST_SLOWER = 64.0, 0.1, 2.0
MOST_SILENT_S = 1.0
"""The gate, on a busy computer."""
SURE_S = 0.1
"""So much a failover may take longer because of a busy computer alone."""
LOOK_S, IDLE_S, SHORT_S = 0.1, 3.0, 3.0
SHORT_GROUPS, USUAL = 3, 3
ATTACKERS = "redteam_attacks"
COLUMNS = "attack", "tries", "outage ms, usually", "memory MB", "processor %", "worst", "result"


def refusal() -> str:
    """Return why nobody can be attacked here; empty: it can be done."""
    if os.geteuid() != 0:
        return "only root can be a second user"
    return "" if shutil.which("setpriv") else "there is no setpriv, which makes one another user"


def as_user(user: int, home: Path) -> List[str]:
    """Return the words that run a command as a user."""
    folders = [f"{name}={home}" for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR", "TMPDIR")]
    ids = f"--reuid={user} --regid={user} --clear-groups".split()
    return ["setpriv", *ids, "env", *folders]


class Use(NamedTuple):
    """The memory in MB, and the processor time in s, of a healer."""

    memory: float
    processor: float


class Result(NamedTuple):
    """The outcome of one attack."""

    attack: str
    tries: int
    outage: float
    usual: float
    memory: float
    processor: float
    worst: str
    faults: List[str]

    def row(self) -> Tuple[str, ...]:
        """Return it as people read it."""
        return (
            self.attack,
            str(self.tries),
            f"{1e3 * self.outage:.0f}, {1e3 * self.usual:.0f}",
            f"{self.memory:.0f}",
            f"{100 * self.processor:.1f}",
            self.worst[1:],
            "; ".join(self.faults) or "held",
        )


class Robot:
    """A robot of ROBOT with healing, and innocent processes; we hear its topics."""

    def __init__(self, graph: Graph) -> None:
        self.graph, self._before = graph, {*psutil.process_iter()}
        self.home = self._folder(ROBOT, 0o700)
        self.theirs = self._folder(STRANGER, 0o777)  # whose code it were that writes here
        words = as_user(ROBOT, self.home)
        self._ours = lambda *command: graph.start(*words, *command)
        self.nodes = {name: self._node(name) for name in NODES}
        self._node("gated", "/gated/raw", GATED)
        models = self._models()
        self.innocent = self._ours(sys.executable, "-m", "http.server", "0", "--bind", "127.0.0.1")
        self._launch = self._ours(
            *("roslaunch", "shsa_core", "shsa.launch", *models, "hold_off:=0.5", "switches:=0"),
        )
        self.records = {f"/{each}": TopicRecord(f"/{each}", Float64Stamped) for each in NODES}
        gate = "rosrun", "shsa_gate", "gate", "gated", "--som", models[1][len("som:=") :]
        self._ours(*gate, f"__name:={GATE[1:]}")
        self.passed: List[Tuple[float, float]] = []
        rospy.Subscriber("/gated", Float64Stamped, self._passed, tcp_nodelay=True)
        graph.healing.await_available(*self.records, "/gated/raw", seconds=60.0)
        wait_until(self._ready, 60.0, "substitutes stand by")
        self._ours(
            *("roslaunch", "shsa_view", "view.launch", *models),
            *(f"view_port:={os.environ['VIEW_PORT']}", "actions:=true"),
        )
        wait_until(_view_listens, 60.0, "the view is there")
        wait_until(lambda: self.passed, 60.0, "the gate lets pass")
        self.healers = {name: psutil.Process(self._pid(name)) for name in HEALERS}
        self.idle = self.rates(IDLE_S)
        self.price = {name: 0.0 for name in HEALERS}  # of one failure, in s

    def _folder(self, user: int, mode: int) -> Path:
        folder = Path(tempfile.mkdtemp(prefix="shsa_redteam_"))
        os.chown(str(folder), user, user)
        folder.chmod(mode)
        return folder

    def _models(self) -> Tuple[str, str]:
        """Return the arguments for an ontology and a SOM with a node that is started again."""
        files = []
        for name, old, new in (
            ("takeover.yaml", "properties:\n", PROPERTIES),
            ("takeover_som.yaml", "services:\n", f"services:\n{MORE}"),
        ):
            files.append(self.home / name)
            files[-1].write_text((DATA / name).read_text("utf-8").replace(old, new), "utf-8")
            os.chown(str(files[-1]), ROBOT, ROBOT)
            files[-1].chmod(0o600)
        return f"ontology:={files[0]}", f"som:={files[1]}"

    def _node(self, name: str, topic: str = "", value: float = 0.0) -> "subprocess.Popen[str]":
        words = [sys.executable, "-m", "shsa_testing.faulty_publisher", f"__name:={name}_node"]
        given = f"_topic:={topic or '/' + name}", f"_value:={value or NODES[name]}"
        return self._ours(*words, *given)

    def _passed(self, message: Float64Stamped) -> None:
        """Note what the gate lets pass."""
        if message._connection_header["callerid"] == GATE:
            self.passed.append((time.monotonic(), message.data))

    def _ready(self) -> bool:
        rows = self.graph.healing.substitutions
        return any(row.service == "hot" for row in rows) and sum(not r.service for r in rows) == 2

    def _pid(self, name: str) -> int:
        wait_until(lambda: node_process(name), 30.0, name)
        return node_pid(name)

    def innocents(self) -> List[psutil.Process]:
        """Return whom nobody may end: all that is not accused rightly, and not a substitute."""
        nodes = [process for name, process in self.nodes.items() if name not in ATTACKED]
        started = [psutil.Process(each.pid) for each in (*nodes, self.innocent, self._launch)]
        return [*started, *self.healers.values()]

    def use(self) -> Dict[str, Use]:
        """Return what each healer has taken so far; 0 of one that is not there."""
        found = {}
        for name, process in self.healers.items():
            try:
                times = process.cpu_times()
                memory = process.memory_info().rss / 1e6
                found[name] = Use(memory, times.user + times.system)
            except psutil.NoSuchProcess:
                found[name] = Use(0.0, 0.0)
        return found

    def rates(self, seconds: float) -> Dict[str, float]:
        """Return the share of a processor that each healer takes."""
        before = self.use()
        time.sleep(seconds)
        after = self.use()
        return {e: (after[e].processor - before[e].processor) / seconds for e in HEALERS}

    def fail(self, name: str) -> float:
        """Hang a node, and start it anew once it is healed; return the outage in s."""
        topic, node, record = f"/{name}", f"/{name}_node", self.records[f"/{name}"]
        since = time.monotonic()
        self.nodes[name].send_signal(signal.SIGSTOP)
        heals = lambda: any(at > since + 0.1 for at, _ in record.others(node, since)[-1:])
        wait_until(heals, 30.0, f"{topic} is healed")
        heard = sorted(at for at, _ in record.heard if at > since - 0.2)
        outage = max(later - at for at, later in zip(heard, heard[1:]))
        self.nodes[name].kill()  # healing may have done so
        self.nodes[name].wait()
        self.nodes[name] = self._node(name)
        self.graph.healing.await_state(topic, "ended", 60.0)
        record.await_node(node)
        return outage

    def usually(self) -> float:
        """Return the outage in s that is usual, and learn what a failure costs the healers."""
        before, began = self.use(), time.monotonic()
        outages = [self.fail("warm") for _ in range(USUAL)]
        took, after = time.monotonic() - began, self.use()
        for each, idle in self.idle.items():
            spent = after[each].processor - before[each].processor - took * idle
            self.price[each] = max(0.0, spent / USUAL)
        return statistics.median(outages)

    def blamed(self) -> Set[str]:
        """Return the topics that had incidents, by what healing writes down."""
        logs = self.home.rglob("shsa_incidents.jsonl")
        lines = [line for log in logs for line in log.read_text("utf-8").splitlines()]
        return {json.loads(line)["topic"] for line in lines}

    def strangers(self) -> List[psutil.Process]:
        """Return the processes of the robot's user that are of a stranger's choice."""
        return [each for each in strange(self._before) if each.pid != self.innocent.pid]

    def leaky(self) -> List[psutil.Process]:
        """Return the processes whose core would hold the secret."""
        secret = (self.home / "shsa" / "secret").read_bytes()
        left = [each for each in self.graph.processes() if not _leaves_no_core(each)]
        return [each for each in left if _holds(each, secret)]

    def gate_faults(self, since: float, timed: bool) -> List[str]:
        """Return what the gate has done wrong since a moment."""
        passed = [each for each in self.passed if each[0] >= since]
        times = [since, *(at for at, _ in passed), time.monotonic()]
        silent = max(later - at for at, later in zip(times, times[1:]))
        faults = []
        if any(value != GATED for _, value in passed):
            faults.append("the gate let a stranger's value pass")
        if timed and silent > MOST_SILENT_S:
            faults.append(f"the gate was silent for {silent:.1f} s")
        return faults

    def is_known(self) -> bool:
        """Return whether the secret is in what a stranger has kept."""
        secret = (self.home / "shsa" / "secret").read_bytes()
        forms = secret, secret.hex().encode(), base64.b64encode(secret)
        kept = [path.read_bytes() for path in self.theirs.rglob("*") if path.is_file()]
        return any(form in data for form in forms for data in kept)

    def end(self) -> None:
        """Remove what it left; the graph ends its processes."""
        for folder in (self.home, self.theirs):
            shutil.rmtree(str(folder), ignore_errors=True)


def _hearts() -> Set[str]:
    """Return the addresses at which processes of the robot hear who hears their signs of life.

    Anybody can list them; whose they are we tell, so that nobody else's are flooded.
    """
    rows = [line.split() for line in Path("/proc/net/unix").read_text("ascii").splitlines()[1:]]
    named = {f"socket:[{row[6]}]": row[7][1:] for row in rows if len(row) > 7 and row[7][0] == "@"}
    own = [e.pid for e in psutil.process_iter(["uids"]) if e.info["uids"].real == ROBOT]
    targets: Set[str] = set()
    for pid in own:
        with suppress(OSError):  # it may have ended
            targets |= {os.readlink(str(path)) for path in Path(f"/proc/{pid}/fd").iterdir()}
    return {named[target] for target in targets if target in named}


def _view_listens() -> bool:
    with socket.socket() as caller:
        return caller.connect_ex(("127.0.0.1", int(os.environ["VIEW_PORT"]))) == 0


def _words(process: psutil.Process) -> List[str]:
    try:
        return list(process.cmdline())
    except psutil.Error:
        return []


class Peak:
    """Watches the memory of the healers."""

    def __init__(self, robot: Robot) -> None:
        self.memory = {name: use.memory for name, use in robot.use().items()}
        self._robot, self._ends = robot, threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def _work(self) -> None:
        while not self._ends.wait(LOOK_S):
            for name, use in self._robot.use().items():
                self.memory[name] = max(self.memory[name], use.memory)

    def end(self) -> None:
        """Watch no more."""
        self._ends.set()
        self._thread.join()


def attack(robot: Robot, names: Sequence[str], seconds: float, usual: float) -> Result:
    """Attack a robot in some ways at once; something really fails meanwhile.

    `usual`: the outage of that without an attack, in s; 0: times are not judged.
    """
    innocent = robot.innocents()
    before, began, peak = robot.use(), time.monotonic(), Peak(robot)
    os.environ["HEARTS"] = " ".join(_hearts())
    words = [*as_user(STRANGER, robot.theirs), sys.executable, "-m", ATTACKERS]
    given = [str(seconds), str(robot.theirs), str(robot.innocent.pid)]
    start = lambda name: robot.graph.start(*words, name, *given, heard=True)
    attackers = [start(name) for name in names]
    time.sleep(seconds / 3.0)
    outage = robot.fail("warm")
    said = [(each.communicate(timeout=seconds + 60.0)[0] or "0").split()[-1] for each in attackers]
    peak.end()
    took, after = time.monotonic() - began, robot.use()
    spent = {e: after[e].processor - before[e].processor - robot.price[e] for e in HEALERS}
    shares = {each: spent[each] / took - robot.idle[each] for each in HEALERS}
    worst = max(shares, key=lambda each: shares[each])
    processor = shares[worst]
    memory = max(peak.memory[each] - before[each].memory for each in HEALERS)
    faults = [f"{' '.join(_named(each))} was ended" for each in innocent if not running(each)]
    if (robot.theirs / "ran").exists():
        faults.append("code was run, or what is private was had")
    faults += [f"{' '.join(_named(each))} was started" for each in robot.strangers()]
    if robot.is_known():
        faults.append("the secret is known")
    faults += [f"a core of {' '.join(_named(each))} has the secret" for each in robot.leaky()]
    faults += [f"{each} is another" for each, p in robot.healers.items() if not _is(each, p)]
    if usual and outage > max(MOST_SLOWER * usual, usual + SURE_S):
        faults.append("healed too late")
    if memory > MOST_MEMORY_MB:
        faults.append("too much memory")
    if usual and processor > MOST_PROCESSOR:
        faults.append(f"too much processor time: {worst}")
    faults += [
        f"{topic} was blamed" for topic in sorted(robot.blamed() - {f"/{e}" for e in ATTACKED})
    ]
    faults += robot.gate_faults(began, bool(usual))
    for name, count in zip(names, said):
        if count == "0":
            faults.append(f"nothing was tried: {name}")
    outcome = sum(map(int, said)), outage, usual, memory, processor, worst, faults
    return Result(", ".join(names), *outcome)


def strange(before: Set[psutil.Process]) -> List[psutil.Process]:
    """Return the servers and attackers that run as the robot's user, and did not before."""
    new = [each for each in psutil.process_iter() if each not in before and _user(each) == ROBOT]
    return [each for each in new if {"http.server", ATTACKERS} & {*_words(each)}]


def _user(process: psutil.Process) -> int:
    try:
        return int(process.uids().real)
    except psutil.Error:
        return -1


def _leaves_no_core(process: psutil.Process) -> bool:
    try:
        return bool(process.rlimit(psutil.RLIMIT_CORE)[0] == 0)
    except psutil.Error:
        return True  # it has ended


def _holds(process: psutil.Process, data: bytes) -> bool:
    """Return whether what a process can write in its memory has some data."""
    try:
        maps = Path(f"/proc/{process.pid}/maps").read_text("utf-8").splitlines()
        with open(f"/proc/{process.pid}/mem", "rb") as memory:
            for begin, end in (row.split()[0].split("-") for row in maps if " rw" in row):
                memory.seek(int(begin, 16))
                if data in memory.read(int(end, 16) - int(begin, 16)):
                    return True
    except (OSError, ValueError):  # it has ended, or that was freed
        return False
    return False


def _named(process: psutil.Process) -> List[str]:
    return [f"process {process.pid}", *_words(process)[:3]]


def _is(name: str, process: psutil.Process) -> bool:
    found = node_process(name)
    return found is not None and found == process


def one(name: str, seconds: float) -> Result:
    """Attack a robot of its own, in a process of its own."""
    with Graph() as graph:
        robot = _robot(graph)
        try:
            return attack(robot, [name], seconds, robot.usually())
        finally:
            robot.end()


def _robot(graph: Graph) -> Robot:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        os.environ["VIEW_PORT"] = str(free.getsockname()[1])
    os.chown(str(graph.folder), ROBOT, ROBOT)
    graph.folder.chmod(0o755)
    return Robot(graph)


def all_of_them(seconds: float) -> List[Result]:
    """Attack one robot in every way, some at once."""
    names = list(ATTACKS)
    with Graph() as graph:
        robot = _robot(graph)
        try:
            groups = [names[k::SHORT_GROUPS] for k in range(SHORT_GROUPS)]
            return [attack(robot, each, seconds, 0.0) for each in groups]
        finally:
            robot.end()


def show(results: List[Result], path: Optional[Path]) -> int:
    """Print the table, and write it to a file; return the exit status."""
    rows = [each.row() for each in results]
    print(tabulate(rows, COLUMNS, tablefmt="github", disable_numparse=True), flush=True)
    if path is not None:
        with open(str(path), "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
    return int(any(each.faults for each in results))


def main() -> int:
    """Attack, and print a table."""
    parser = argparse.ArgumentParser(prog="tools/redteam", description=__doc__)
    parser.add_argument("attacks", nargs="*", help=f"of these: {', '.join(ATTACKS)}; none: all")
    parser.add_argument("--seconds", type=float, default=60.0, help="so long each attack takes")
    parser.add_argument("--short", action="store_true", help="one robot, each for a few seconds")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there, too")
    parser.add_argument("--json", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    unknown = sorted({*options.attacks} - {*ATTACKS})
    if unknown:
        parser.error(f"no such attack: {', '.join(unknown)}; there are {', '.join(ATTACKS)}")
    why = refusal()
    if why:
        print(f"Nothing is attacked: {why}.")
        return 0
    if options.short:
        return show(all_of_them(SHORT_S), options.csv)
    if options.json:
        print(json.dumps(one(options.attacks[0], options.seconds)), flush=True)
        return 0
    results = []
    for name in tqdm(options.attacks or ATTACKS, disable=None):
        # A process each: rospy is a node of one master alone.
        command = [sys.executable, __file__, "--json", "--seconds", str(options.seconds), name]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
        results.append(Result(*json.loads(done.stdout.splitlines()[-1])))
    return show(results, options.csv)


if __name__ == "__main__":
    sys.exit(main())

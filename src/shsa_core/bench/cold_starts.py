"""A cold start: from the order to the first message, by rosrun, by python and by a fork; memory.

    python3 cold_starts.py [--starts N] [--short] [--only NAME ...] [--results DIR]

Each substitute passes on a topic of 100 Hz, and its row says already that it publishes. A rospy and
a roscpp consumer wait for it. Then so many hot ones run, and the kernel is
asked for the memory of each. Writes cold_starts.csv and cold_starts_memory.csv.
"""
import itertools
import os
import sys
import time
from subprocess import Popen
from typing import Dict, Iterator, List, Set, Tuple

import psutil
import rosgraph
from roslib.packages import find_node
from shsa_msgs.msg import Substitutions

from graph import BENCH, PATIENCE_S, Graph, ask_to_leave
from report import arguments, in_words, print_table, write_table
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.ros.graph import secret
from shsa_core.ros.graph.confinement import environment
from shsa_core.ros.graph.forking import Forking
from shsa_core.ros.graph.signing import Signing
from shsa_core.ros.graph.tables import TablePublisher
from shsa_core.ros.wire.names import SUBSTITUTIONS
from shsa_core.ros.wire.rows import substitution_message
from shsa_core.substitution import signals
from shsa_testing.waiting import wait_until

TYPE = "shsa_msgs/Float64Stamped"
WAYS = ("rosrun", "python", "forked")
COLUMNS = ("way", "consumer", "start", "time_ms")
MEMORY_COLUMNS = ("way", "processes", "rss_mb", "pss_mb", "uss_mb")
HOT = (10, 100)
SETTLING_TIME_S = 3.0
PERIOD_S = 0.01
NAMES = itertools.count(1)


class Starts:
    """Starts substitutes in each way, in one graph."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        path = str(graph.folder / "secret")
        self._table = TablePublisher(
            SUBSTITUTIONS, Substitutions, "substitutions", lambda row: row.node, Signing(path)
        )
        self._path = find_node("shsa_core", "substitute")[0]
        os.environ.update({secret.VARIABLE: path, "ROS_NAMESPACE": "/"})
        self._variables = environment(os.environ)
        self._variables.update({k: v for k, v in os.environ.items() if k.startswith("SHSA_")})
        self.forking = Forking(["rosrun", "shsa_core", "substitute"], self._variables, [TYPE])
        wait_until(self.forking.ready.is_set, PATIENCE_S, "the prepared process")
        graph.python(BENCH / "stream_source.py", "1", str(PERIOD_S))
        wait_until(lambda: "/stream_0" in _listed(0), PATIENCE_S, "the stream")

    def start(self, way: str, topic: str, publishes: bool) -> psutil.Process:
        """Start a substitute of a topic."""
        name = f"cold_{next(NAMES)}"
        read, written = (
            (Signal(each, "data", TYPE, "", PERIOD_S, 0.5),) for each in ("/stream_0", topic)
        )
        code = "y=x[0]"
        row = Substitution(f"/{name}", topic[1:], read, code, written, publishing=publishes)
        self._table.update([substitution_message(row)])
        words = ["/stream_0/data", code, f"{topic}/data", f"__name:={name}"]
        added = {signals.VARIABLE: signals.encode(read, written)}
        if way == "forked":
            forked = self.forking.start([self._path, *words], {**self._variables, **added})
            if forked is None:
                raise RuntimeError("nothing was forked")
            return psutil.Process(forked.pid)
        command = ["rosrun", "shsa_core", os.path.relpath(self._path, _package())]
        if way == "python":
            command = [sys.executable, self._path]
        given = (f"{key}={value}" for key, value in added.items())
        return psutil.Process(self._graph.start("env", *given, *command, *words).pid)

    def measure(self, way: str, number: int) -> Dict[str, float]:
        """The time in ms until each consumer has heard its first message."""
        topic = f"/cold_{way}_{number}"
        consumers = {
            "rospy": self._graph.python(BENCH / "consumer.py", topic, heard=True),
            "roscpp": self._graph.cpp("consumer", topic, heard=True),
        }
        wait_until(lambda: len(_nodes(1, topic)) == len(consumers), PATIENCE_S, "the consumers")
        began = time.monotonic()
        process = self.start(way, topic, publishes=True)
        took = {name: 1000.0 * (_first(each) - began) for name, each in consumers.items()}
        process.kill()
        for each in consumers.values():
            ask_to_leave(each)
        return took

    def memory(self, way: str, count: int) -> Tuple[float, float, float]:
        """The mean RSS, PSS and USS of so many muted substitutes, each of its own topic, in MB."""
        before = len(_nodes(1, "/stream_0"))
        processes = [self.start(way, f"/hot_{way}_{n}", publishes=False) for n in range(count)]
        connected = lambda: len(_nodes(1, "/stream_0")) >= before + count
        wait_until(connected, 4 * PATIENCE_S, f"{count} substitutes")
        time.sleep(SETTLING_TIME_S)
        found = [each.memory_full_info() for each in processes]
        for each in processes:
            each.kill()
        rss, pss, uss = (
            sum(getattr(each, kind) for each in found) / count / 1e6
            for kind in ("rss", "pss", "uss")
        )
        return rss, pss, uss


def _package() -> str:
    return str(BENCH.parent)


def _listed(kind: int) -> Dict[str, Set[str]]:
    """The nodes of each topic; kind 0: its publishers, 1: its subscribers."""
    return {t: set(nodes) for t, nodes in rosgraph.Master("/bench").getSystemState()[kind]}


def _nodes(kind: int, topic: str) -> Set[str]:
    return _listed(kind).get(topic, set())


def _first(consumer: "Popen[str]") -> float:
    """When a consumer heard its first message."""
    assert consumer.stdout is not None
    lines: Iterator[List[str]] = (line.split() for line in consumer.stdout)
    return next(float(words[1]) for words in lines if words[0] == "message")


def main() -> None:
    """Measure and print."""
    assert __doc__ is not None
    options = arguments(__doc__, "starts", 20, "two starts of each and the memory of three")
    ways = [way for way in WAYS if any(word in way for word in options.only)]
    starts, counts = (2, (3,)) if options.short else (options.starts, HOT)
    rows: List[Tuple[str, str, int, float]] = []
    memory: List[Tuple[str, int, float, float, float]] = []
    with Graph() as graph:
        bench = Starts(graph)
        for number, way in itertools.product(range(starts), ways):
            rows += [(way, c, number, took) for c, took in bench.measure(way, number).items()]
        for way, count in itertools.product(ways, counts):
            memory.append((way, count, *bench.memory(way, count)))
    write_table(options.results / "cold_starts.csv", COLUMNS, rows)
    write_table(options.results / "cold_starts_memory.csv", MEMORY_COLUMNS, memory)
    print_table(
        f"From the order to the first message, ms: median / p95 / max of {starts}",
        ("way", "rospy", "roscpp"),
        [
            (way, *(in_words([t for w, c, _, t in rows if (w, c) == (way, consumer)], 0)
                    for consumer in ("rospy", "roscpp")))
            for way in ways
        ],
    )  # fmt: skip
    print_table(
        "Memory of a hot substitute, MB",
        ("way", "processes", "RSS", "PSS", "USS"),
        [(way, str(n), *(f"{each:.1f}" for each in found)) for way, n, *found in memory],
    )


if __name__ == "__main__":
    main()

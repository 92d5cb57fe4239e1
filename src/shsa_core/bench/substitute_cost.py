"""Cost of a substitute: its share of a core by what it does, and a line through the figures.

A process that is idle, prepared for a plan (warm), computing but muted (hot), and publishing; with
1 to 16 inputs of 10 to 500 Hz, its output as often as one input. CPU time is what the kernel
counted for all of its threads (/proc/PID/task/*/schedstat).

The line: cores = process + read * messages read/s + step * values computed/s + send * messages
sent/s; least squares, relative to each figure. Writes results/bench/substitute_cost.csv.
"""
import argparse
import itertools
import json
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Dict, List, NamedTuple, Optional, Tuple

import numpy as np
import rospy
from roslib.packages import find_node
from shsa_msgs.msg import Float64Stamped, Substitutions
from tqdm import tqdm

from graph import BENCH, PATIENCE_S, Graph, ask_to_leave, service, write_som
from report import print_table, write_table
from shsa_core.codegen.plans import plan_service
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.service import Deadlines
from shsa_core.model.substitution import Substitution
from shsa_core.ros.trust import secret
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.messages.tables import TablePublisher
from shsa_core.ros.wire.names import SUBSTITUTIONS
from shsa_core.ros.wire.rows import substitution_message
from shsa_core.search.derivation import SourceTable
from shsa_testing.waiting import wait_until

STATES = ("idle", "warm", "hot", "publishing")
RATES_HZ = (10.0, 50.0, 100.0, 500.0)
INPUTS = (1, 4, 16)
SETTLING_TIME_S = 2.0
COLUMNS = ("state", "rate_hz", "inputs", "cores", "start_cpu_s", "came_hz")
NAMES = itertools.count(1)


class Figure(NamedTuple):
    """One measurement: `cores` busy, and the CPU time of the start, in s.

    `came`: how often an input came and the output was heard, in Hz.
    """

    state: str
    rate: float
    inputs: int
    cores: float
    start: float
    came: Tuple[float, float]

    @property
    def counts(self) -> Tuple[float, float, float, float]:
        """Processes, messages read, values computed and messages sent, each per s."""
        read, sent = self.came
        reads = 0.0 if self.state == "idle" else read * self.inputs
        return 1.0, reads, self.rate if self.state == "hot" else sent, sent


class Bench:
    """A graph with a table of substitutions that commands what is measured."""

    def __init__(self, graph: Graph, seconds: float) -> None:
        self._graph, self._seconds = graph, seconds
        path = str(graph.folder / "secret")
        os.environ[secret.VARIABLE] = path
        signing = Signing(path)
        self._table = TablePublisher(
            SUBSTITUTIONS, Substitutions, "substitutions", lambda row: row.node, signing
        )
        self._heard = {"/stream_0": 0, "/lost": 0}
        for topic in self._heard:
            rospy.Subscriber(topic, Float64Stamped, self._hear, topic, tcp_nodelay=True)

    def _hear(self, _message: Float64Stamped, topic: str) -> None:
        self._heard[topic] += 1

    def measure(self, state: str, rate: float, inputs: int) -> Figure:
        """One substitute in a state."""
        source = self._graph.python(BENCH / "stream_source.py", str(inputs), str(1.0 / rate))
        name = f"/measured_{next(NAMES)}"
        (standby,) = find_node("shsa_core", "standby")[:1]
        process = self._graph.start(standby, f"__name:={name[1:]}")
        wait_until(lambda: name in _nodes(), PATIENCE_S, name)
        start = cpu_time(process.pid)
        row = self._row(name, state, rate, inputs)
        if row is not None:
            self._table.update([substitution_message(row)])
        time.sleep(SETTLING_TIME_S)
        heard, begin, before = [*self._heard.values()], time.monotonic(), cpu_time(process.pid)
        time.sleep(self._seconds)
        cores, took = cpu_time(process.pid) - before, time.monotonic() - begin
        read, sent = ((now - then) / took for now, then in zip(self._heard.values(), heard))
        if (sent > 0.0) is not (state == "publishing"):
            raise RuntimeError(f"{state}, {inputs} inputs: {sent:g} Hz came")
        self._table.update([], [name, ""])
        for each in (process, source):
            ask_to_leave(each)
        return Figure(state, rate, inputs, cores / took, start, (read, sent))

    def _row(self, name: str, state: str, rate: float, inputs: int) -> Optional[Substitution]:
        """Return its row in the table; none for a process without a plan."""
        if state == "idle":
            return None
        topics = [f"/stream_{i}" for i in range(inputs)]
        services = [service(topic, "/stream_source", 1.0 / rate) for topic in topics]
        lost = service("/lost", "/nobody", 1.0 / rate, needed=True)
        som = read_som(str(write_som(self._graph.folder / "som.yaml", [*services, lost])))
        named = [topic.strip("/") for topic in topics]
        model = {
            "properties": {each: {} for each in [*named, "lost"]},
            "relations": {"sum": {"lost": " + ".join(named)}},
        }
        path = self._graph.folder / "ontology.yaml"
        path.write_text(json.dumps(model))
        ontology = read_ontology(str(path))
        table = SourceTable(ontology.network, som.sources)
        plan = plan_service(ontology, som.services["lost"], table, ["/nobody"])
        signals = [
            tuple(som.signal(each, Deadlines()) for each in sources)
            for sources in (plan.inputs, plan.outputs)
        ]
        return Substitution(
            "" if state == "warm" else name,
            "lost",
            signals[0],
            plan.program.code,
            signals[1],
            publishing=state == "publishing",
        )


def cpu_time(pid: int) -> float:
    """The CPU time that the threads of a process have used, in s; of those that have not ended."""
    spent = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):
            spent += int((task / "schedstat").read_text().split()[0])
    return spent / 1e9


def fit(figures: List[Figure]) -> Dict[str, float]:
    """Return the cost of each part, in s of a core."""
    counts = np.array([each.counts for each in figures])
    cores = np.array([each.cores for each in figures])
    parts = np.linalg.lstsq(counts / cores[:, None], np.ones(len(cores)), rcond=None)[0]
    return dict(zip(("process", "read", "step", "send"), map(float, parts)))


def estimate(parts: Dict[str, float], figure: Figure) -> float:
    """Return the cores by the fitted line."""
    return float(np.dot(list(parts.values()), figure.counts))


def _nodes() -> List[str]:
    state = rospy.get_master().getSystemState()[2][0]
    return [node for _, nodes in state for node in nodes]


def main() -> None:
    """Measure, fit and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each figure")
    parser.add_argument("--short", action="store_true", help="two rates and two numbers of inputs")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    rates, numbers = (RATES_HZ[:2], INPUTS[:2]) if options.short else (RATES_HZ, INPUTS)
    cases = [("idle", rates[0], 1), *itertools.product(STATES[1:], rates, numbers)]
    with Graph() as graph:
        bench = Bench(graph, options.seconds)
        figures = [bench.measure(*case) for case in tqdm(cases)]
    parts = fit(figures)
    options.results.mkdir(parents=True, exist_ok=True)
    write_table(options.results / "substitute_cost.csv", COLUMNS, figures)
    print_table(
        "A substitute's share of a core, %",
        ("state", "Hz", "inputs", "measured", "by the line"),
        [
            (f.state, f"{f.rate:g}", str(f.inputs), f"{100 * f.cores:.2f}",
             f"{100 * estimate(parts, f):.2f}")
            for f in figures
        ],
    )  # fmt: skip
    words = [(name, f"{1e6 * value:.1f}") for name, value in parts.items()]
    print_table("The line, µs of a core", ("a second of a process, or each", "µs"), words)
    starts = [each.start for each in figures]
    print(f"CPU time of a start: {np.median(starts):.2f} s (median of {len(starts)})")


if __name__ == "__main__":
    main()

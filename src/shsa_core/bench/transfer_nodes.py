"""The paper's second experiment (Section V-B2, Fig. 11): a transfer node's times.

They are taken over the number of application nodes.

A transfer node is a substitute, started by rosrun with its three strings. The paper's four times of
each, in ms:
    start: the call that starts it.   up: from that call until a subscriber receives its first
    message. shut: the call that kills it.     down: from that call until a subscriber misses its
    first message.
And beside them:
    registered: from the start until the master knows the node. unregistered: from the kill until
    its registrations are gone.   gone: from the kill until its process has ended.
Then takeovers of warm and hot topics: from the last good message before a kill -9 to the first one
after it.

Rows are appended to transfer_nodes.csv and counted: a measurement that was interrupted goes on
where it was. Draws transfer_nodes.png.
"""
import argparse
import csv
import itertools
import random
import sys
import threading
import time
from pathlib import Path
from typing import Dict, Iterable, List, Mapping, Tuple

import matplotlib.pyplot as plt
import rosgraph
import rospy
from tqdm import tqdm

from contenders import Healed, repeat
from graph import FAULTY_PUBLISHER, PATIENCE_S, Graph, ask_to_leave, shut_down, uri_of
from report import in_words, print_table
from robot import KEPT_NODE, KEPT_TOPIC, TOPIC, Applications, Consumers, talker, write_model
from shsa_core.codegen.plans import plan_service
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.ros.master.som_parameter import put_som
from shsa_core.search.derivation import SourceTable
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
SILENT_PERIODS = 5  # without a message: there will be no more
NUMBERS = itertools.count(1)
RATE = 1.0  # Hz, of each application node
COLUMNS = ("measure", "nodes", "repetition", "time_ms")
PAPER = ("start", "up", "shut", "down")
TRANSFER = (*PAPER, "registered", "unregistered", "gone")
TAKEOVERS = ("warm", "hot")
PARTS = ("transfer", *TAKEOVERS)


class Results:
    """The rows of the CSV file, those of earlier runs included.

    Raises SystemExit if it holds something else.
    """

    def __init__(self, path: Path) -> None:
        self.values: Dict[Tuple[str, int], List[float]] = {}
        self._path = path
        if path.exists():
            with open(path, newline="") as file:
                reader = csv.DictReader(file)
                if tuple(reader.fieldnames or ()) != COLUMNS:
                    raise SystemExit(f"{path} holds other measures; --fresh begins anew.")
                for row in reader:
                    key = (row["measure"], int(row["nodes"]))
                    self.values.setdefault(key, []).append(float(row["time_ms"]))
        else:
            self._write([COLUMNS])

    def add(self, nodes: int, times: Mapping[str, float]) -> None:
        """Append the rows of a repetition, all at once: who interrupts it cuts none in two."""
        rows = []
        for measure, value in times.items():
            values = self.values.setdefault((measure, nodes), [])
            values.append(value)
            rows.append((measure, nodes, len(values), f"{value:.3f}"))
        self._write(rows)

    def count(self, measure: str, nodes: int) -> int:
        """Count the rows."""
        return len(self.values.get((measure, nodes), ()))

    def _write(self, rows: Iterable[Tuple[object, ...]]) -> None:
        with open(self._path, "a", newline="") as file:
            csv.writer(file).writerows(rows)


class TransferNode:
    """Starts and stops transfer nodes beside a node that publishes their input."""

    def __init__(self, graph: Graph, consumers: Consumers) -> None:
        self._graph = graph
        self._consumer = consumers.rospy
        paths = write_model(graph.folder, "cold", PERIOD_S)
        ontology, som = read_ontology(str(paths[0])), read_som(str(paths[1]))
        put_som(som)
        table = SourceTable(ontology.network, som.sources)
        (lost,) = som.of_topic(TOPIC)
        self._program = plan_service(ontology, lost, table).program
        arguments = talker(KEPT_NODE, KEPT_TOPIC, 2.0, PERIOD_S)
        self._steady = graph.python(FAULTY_PUBLISHER, *arguments)

    def measure(self) -> Tuple[float, ...]:
        """Start one and stop it; its times in ms, in the order of TRANSFER."""
        node = f"/transfer_{next(NUMBERS)}"
        wait_until(lambda: uri_of(KEPT_NODE) != "", PATIENCE_S, f"{KEPT_NODE} is up")
        self._consumer.forget()
        program = self._program
        strings = (",".join(program.inputs), program.code, ",".join(program.outputs))
        begun = time.monotonic()
        process = self._graph.start(
            "rosrun", "shsa_core", "substitute", *strings, f"__name:={node[1:]}"
        )
        start = time.monotonic() - begun
        heard = lambda: [m.at for m in self._consumer.since(begun) if m.node == node]
        wait_until(lambda: uri_of(node) != "", PATIENCE_S, f"{node} registers")
        registered = time.monotonic() - begun
        wait_until(lambda: bool(heard()), PATIENCE_S, f"{node} publishes")
        up = heard()[0] - begun
        time.sleep(random.random() * PERIOD_S)
        asked = time.monotonic()
        shut: List[float] = []
        killer = threading.Thread(target=_kill, args=(node, shut))
        killer.start()
        wait_until(lambda: not _has_services(node), PATIENCE_S, f"{node} unregisters")
        unregistered = time.monotonic() - asked
        wait_until(lambda: process.poll() is not None, PATIENCE_S, f"the process of {node} ends")
        gone = time.monotonic() - asked
        killer.join()
        silent = lambda: time.monotonic() > heard()[-1] + SILENT_PERIODS * PERIOD_S
        wait_until(silent, PATIENCE_S, f"nobody hears {node} any more")
        down = heard()[-1] + PERIOD_S - asked
        times = (start, up, shut[0], down, registered, unregistered, gone)
        return tuple(1e3 * each for each in times)

    def end(self) -> None:
        """Stop the node that publishes the input."""
        ask_to_leave(self._steady)


def _kill(node: str, took: List[float]) -> None:
    """The kill call, and how long it took (s).

    The node does not answer it: it lasts until the process is gone.
    """
    begun = time.monotonic()
    shut_down(node)
    took.append(time.monotonic() - begun)


def _has_services(node: str) -> bool:
    """Return whether the master knows a rospy node's services, which it unregisters last.

    The node's name will not do: one that has ever logged a warning stays known by a subscribed
    parameter.
    """
    try:
        rosgraph.Master(rospy.get_name()).lookupService(node + "/set_logger_level")
    except rosgraph.MasterException:
        return False
    return True


def plot(results: Results, path: Path) -> None:
    """Box plots over the number of application nodes, one panel a measure: first the paper's."""
    measured = {name for name, _ in results.values}
    taken_over = any(name in measured for name in TAKEOVERS)
    columns = 3 if taken_over else 2
    size = 4.3 * columns, 7.0
    figure, axes = plt.subplots(2, columns, figsize=size, constrained_layout=True)
    for axis, measure in zip(axes.T.flat, (*PAPER, *TAKEOVERS)):
        steps = sorted(nodes for name, nodes in results.values if name == measure)
        if steps:
            axis.boxplot(
                [results.values[measure, nodes] for nodes in steps],
                labels=[str(nodes) for nodes in steps],
                flierprops={"markersize": 3},
            )
        taken = " takeover" if measure in TAKEOVERS else ""
        axis.set_title(f"{measure}{taken}")
        axis.set_ylabel("ms")
        axis.set_ylim(bottom=0.0)
        axis.grid(True, axis="y", alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("application nodes")
    figure.savefig(str(path), dpi=120)
    plt.close(figure)


def show(results: Results) -> None:
    """Print the table."""
    columns = ("nodes", "n", *TRANSFER, *(f"{word} takeover" for word in TAKEOVERS))
    table: List[Tuple[str, ...]] = []
    for nodes in sorted({nodes for _, nodes in results.values}):
        counts = {m: results.count(m, nodes) for m in (*TRANSFER, *TAKEOVERS)}
        least, most = min(counts.values()), max(counts.values())
        figures = [in_words(results.values.get((m, nodes), ()), 0) for m in counts]
        count = str(most) if least == most else f"{least}-{most}"
        table.append((str(nodes), count, *figures))
    title = "Times in ms over the number of application nodes: median / p95 / max"
    print_table(title, columns, table)


def main() -> int:
    """Measure what is still missing; 1 if something did not come up or was not healed in time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=100)
    levels_of_paper = [0, 50, *range(100, 501, 100)]
    parser.add_argument("--nodes", type=int, nargs="+", default=levels_of_paper)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="only these parts")
    parser.add_argument("--fresh", action="store_true", help="forget what was measured before")
    parser.add_argument("--short", action="store_true", help="once with 0 and 5 nodes, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    repetitions = 1 if options.short else options.repetitions
    levels = [0, 5] if options.short else sorted(options.nodes)
    path = options.results / "transfer_nodes.csv"
    if options.fresh and path.exists():
        path.unlink()
    results = Results(path)
    misses = 0
    # A transfer node's last measure tells that all of them are there.
    lasts = [TRANSFER[-1] if part == "transfer" else part for part in options.only]
    total = len(lasts) * len(levels) * repetitions
    done = sum(min(repetitions, results.count(last, nodes)) for last in lasts for nodes in levels)
    if done:
        print(f"{done} repetitions are there already; --fresh forgets them.")
    with Graph() as graph, tqdm(total=total, initial=done, disable=None) as progress:
        consumers = Consumers(graph, TOPIC)
        applications = Applications(graph, RATE)
        for nodes in levels:
            if all(results.count(last, nodes) >= repetitions for last in lasts):
                continue
            progress.set_description(f"{nodes} nodes")
            applications.grow(nodes)

            def transfer(node: TransferNode) -> None:
                results.add(nodes, dict(zip(TRANSFER, node.measure())))
                progress.update()

            enough = lambda: results.count(TRANSFER[-1], nodes) >= repetitions
            if "transfer" in options.only and not enough():
                misses += repeat(graph, lambda: TransferNode(graph, consumers), transfer, enough)
            for standby in TAKEOVERS:
                if standby not in options.only or results.count(standby, nodes) >= repetitions:
                    continue

                def take_over(robot: Healed) -> None:
                    robot.await_well()
                    results.add(nodes, {standby: robot.fail().rospy_ms})
                    progress.update()

                make = lambda: Healed(graph, consumers, standby, PERIOD_S)
                enough = lambda: results.count(standby, nodes) >= repetitions
                misses += repeat(graph, make, take_over, enough)
    show(results)
    plot(results, options.results / "transfer_nodes.png")
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())

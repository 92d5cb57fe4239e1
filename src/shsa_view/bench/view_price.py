"""The live view's price: its share of a core beside that of the monitor, in the same run.

200 services at 50 Hz, each with its value; nobody looks at the view, one page does, and 20 do. The
goal: with one page less than 5 % of a core, and at most 10 events a second.
Writes results/bench/view_price.csv.
"""
import argparse
import json
import socket
import subprocess
import threading
import time
from contextlib import suppress
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, Dict, List

import psutil

from graph import BENCH, MONITOR, Graph, ask_to_leave, service, write_som
from report import Goals, print_table, write_table
from shsa_testing.waiting import wait_until

TOPICS, SOURCES = 200, 4
EACH = TOPICS // SOURCES
PERIOD_S = 0.02
READERS = (0, 1, 20)
SETTLING_S = 5.0
PATIENCE_S = 120.0
MOSTLY = 0.9
"""Of the services have a rate when measuring begins: a busy computer lets some fail."""
MOST_PERCENT, MOST_EVENTS = 5.0, 10.0
VIEW = Path(__file__).resolve().parent.parent / "nodes" / "view"
RECONFIGURATOR = MONITOR.parent / "reconfigurator"
COLUMNS = ("readers", "round", "view_percent", "monitor_percent", "events_per_s", "kB_per_s")


class Reader:
    """A page that looks: it counts events and bytes."""

    def __init__(self, port: int) -> None:
        self.events = self.bytes = 0
        self._connection = HTTPConnection("127.0.0.1", port)
        self._connection.request("GET", "/api/events")
        self._socket: Any = self._connection.sock
        self._answer = self._connection.getresponse()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with suppress(OSError, ValueError):  # it was closed
            for line in self._answer:
                self.events += line.startswith(b"event: ")
                self.bytes += len(line)

    def close(self) -> None:
        """Look no more."""
        self._socket.shutdown(socket.SHUT_RDWR)


def told(port: int) -> int:
    """Of how many services the view tells a rate."""
    try:
        connection = HTTPConnection("127.0.0.1", port, timeout=10.0)
        connection.request("GET", "/api/state")
        services = json.loads(connection.getresponse().read())["services"]
        connection.close()
    except OSError:
        return 0
    return sum(row["rate"] is not None for row in services.values())


def used(process: "psutil.Process") -> float:
    """Return the time of the CPU in s that a process has taken."""
    times = process.cpu_times()
    return float(times.user + times.system)


def measure(port: int, pids: Dict[str, int], readers: int, seconds: float) -> Dict[str, object]:
    """One run with so many pages open."""
    pages = [Reader(port) for _ in range(readers)]
    time.sleep(SETTLING_S)
    processes = {name: psutil.Process(pid) for name, pid in pids.items()}
    before = {name: used(process) for name, process in processes.items()}
    events, sent = sum(page.events for page in pages), sum(page.bytes for page in pages)
    begun = time.monotonic()
    time.sleep(seconds)
    elapsed = time.monotonic() - begun
    row: Dict[str, object] = {
        f"{name}_percent": round(100.0 * (used(process) - before[name]) / elapsed, 1)
        for name, process in processes.items()
    }
    events, sent = (
        sum(page.events for page in pages) - events,
        sum(page.bytes for page in pages) - sent,
    )
    each = max(1, readers)
    row["events_per_s"] = round(events / elapsed / each, 1)
    row["kB_per_s"] = round(sent / elapsed / each / 1000.0, 1)
    for page in pages:
        page.close()
    return row


def started(graph: Graph, period: float, port: int) -> "Dict[str, subprocess.Popen[str]]":
    """Start the sources of all topics, healing and the view, which shows them then."""
    nodes = ["/stream_source", *(f"/another_source_{k}" for k in range(1, SOURCES))]
    services = [
        service(f"/stream_{i}", nodes[i // EACH], period, {"range": [0, 1e9]})
        for i in range(TOPICS)
    ]
    som = write_som(graph.folder / "som.yaml", services)
    ontology = graph.folder / "ontology.yaml"
    properties = {f"stream_{i}": {"unit": "s"} for i in range(TOPICS)}
    ontology.write_text(json.dumps({"properties": properties}))
    for k, node in enumerate(nodes):
        words = (str(EACH), str(period), str(k * EACH), f"__name:={node[1:]}")
        graph.python(BENCH / "stream_source.py", *words)
    models = ("--ontology", str(ontology), "--som", str(som))
    processes = {
        "healer": graph.python(RECONFIGURATOR, *models),
        "monitor": graph.python(MONITOR, *models),
        "view": graph.python(VIEW, *models, "--port", str(port)),
    }
    shows = lambda: told(port) >= MOSTLY * TOPICS
    wait_until(shows, PATIENCE_S, "the view shows the services")
    return processes


def main() -> None:
    """Measure, print a table, write the CSV file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")
    parser.add_argument("--port", type=int, default=18999)
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    rows: List[Dict[str, object]] = []
    with Graph() as graph:
        processes = started(graph, PERIOD_S, options.port)
        pids = {name: processes[name].pid for name in ("view", "monitor")}
        for number in range(options.rounds):
            for readers in READERS:
                found = measure(options.port, pids, readers, options.seconds)
                rows.append({"readers": readers, "round": number + 1, **found})
        for process in reversed([*processes.values()]):
            ask_to_leave(process)
    told = [[str(row[name]) for name in COLUMNS] for row in rows]
    write_table(options.results / "view_price.csv", COLUMNS, told)
    print_table("The view's price", COLUMNS, told)
    goals = Goals()
    seen = [row for row in rows if row["readers"] == 1]
    for goal, column, most, unit in (
        ("share of a core with one page", "view_percent", MOST_PERCENT, "%"),
        ("events with one page", "events_per_s", MOST_EVENTS, "/s"),
    ):
        worst = max(float(str(row[column])) for row in seen)
        goals.at_most(goal, f"view of {TOPICS} services", most, worst, unit)
    goals.show(options.results / "view_price_goals.csv")


if __name__ == "__main__":
    main()

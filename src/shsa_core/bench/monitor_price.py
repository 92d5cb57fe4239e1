"""The monitor's price: its share of a CPU, and its probe effect on the streams that it watches.

50 topics at 1,000 and at 10,000 messages/s together; a consumer beside the monitor listens to 5 of
them. Without the monitor; with it, values not checked; values checked; and half of them calibrated
by the other half, which another node publishes: taken in turns.
Writes results/bench/monitor_price.csv.
"""
import argparse
import csv
import json
from pathlib import Path
from typing import Dict, List, Optional

import numpy as np
import psutil

from graph import BENCH, MONITOR, Graph, ask_to_leave, service, write_som
from report import print_table

TOPICS = 50
PROBED = 5
SETTLING_TIME_S = 3.0
CALIBRATED = "values checked, calibrated"
MODES = ("no monitor", "values not checked", "values checked", CALIBRATED)
SOURCES = ("/stream_source", "/another_source")
EACH = TOPICS // len(SOURCES)
COLUMNS = (
    "messages_per_s",
    "mode",
    "round",
    "monitor_cpu_percent",
    "jitter_p50_us",
    "jitter_p99_us",
    "jitter_max_us",
    "latency_p50_us",
    "latency_p99_us",
)


def measure(graph: Graph, rate: float, mode: str, seconds: float) -> Dict[str, object]:
    """One run: the row of figures, times in us."""
    period = TOPICS / rate
    value = {"checks": {"not_a_number": mode in MODES[2:]}}
    services = [
        service(f"/stream_{i}", SOURCES[i // EACH], period, value, needed=i < EACH)
        for i in range(TOPICS)
    ]
    som = write_som(graph.folder / "som.yaml", services)
    models = ["--som", str(som)]
    if mode == CALIBRATED:
        models += ["--ontology", str(_write_ontology(graph.folder / "ontology.yaml"))]
    sources = [
        graph.python(
            BENCH / "stream_source.py", str(EACH), str(period), str(k * EACH), f"__name:={node[1:]}"
        )
        for k, node in enumerate(SOURCES)
    ]
    monitor = None if mode == "no monitor" else graph.python(MONITOR, *models)
    path = graph.folder / "rows.npy"
    wanted = SETTLING_TIME_S + seconds
    probe = graph.python(BENCH / "stream_probe.py", str(path), str(PROBED), str(wanted))
    share = _cpu_share(monitor.pid if monitor else None, seconds)
    probe.wait(wanted + 30.0)
    rows = np.load(path)
    path.unlink()
    for process in (monitor, *sources):
        if process is not None:
            ask_to_leave(process)
    return {"messages_per_s": rate, "mode": mode, **_figures(rows, seconds, period), **share}


def _write_ontology(path: Path) -> Path:
    """Let each stream of the first node follow from one of the second."""
    model = {
        "properties": {f"stream_{i}": {} for i in range(TOPICS)},
        "relations": {
            f"r{i}": {f"stream_{i}": f"1.5 * stream_{EACH + i} + 0.5"} for i in range(EACH)
        },
    }
    path.write_text(json.dumps(model))  # JSON is YAML as well
    return path


def _cpu_share(process: Optional[int], seconds: float) -> Dict[str, object]:
    psutil.cpu_percent(interval=SETTLING_TIME_S)
    if process is None:
        return {"monitor_cpu_percent": 0.0}
    return {"monitor_cpu_percent": psutil.Process(process).cpu_percent(interval=seconds)}


def _figures(rows: np.ndarray, seconds: float, period: float) -> Dict[str, object]:
    rows = rows[rows[:, 2] > rows[-1, 2] - seconds]
    jitter: List[float] = []
    for topic in range(PROBED):
        received = rows[rows[:, 0] == topic][:, 2]
        jitter.extend(np.abs(np.diff(received) - period) * 1e6)
    latency = (rows[:, 2] - rows[:, 1]) * 1e6
    return {
        "jitter_p50_us": round(float(np.percentile(jitter, 50)), 1),
        "jitter_p99_us": round(float(np.percentile(jitter, 99)), 1),
        "jitter_max_us": round(float(np.max(jitter)), 1),
        "latency_p50_us": round(float(np.percentile(latency, 50)), 1),
        "latency_p99_us": round(float(np.percentile(latency, 99)), 1),
    }


def main() -> None:
    """Measure, print a table, write the CSV file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each run")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    table: List[List[str]] = []
    with Graph() as graph, open(options.results / "monitor_price.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for rate in (1000.0, 10000.0):
            for number in range(options.rounds):
                for mode in MODES:
                    row = measure(graph, rate, mode, options.seconds)
                    row["round"] = number + 1
                    writer.writerow(row)
                    file.flush()
                    table.append([str(row[column]) for column in COLUMNS])
    print_table("The monitor's price", COLUMNS, table)


if __name__ == "__main__":
    main()

"""Cost of watching large messages whose values nobody judges: the monitor's share of a core.

Images at 30 Hz, watched by a monitor that copies every message, as if values were judged, and by
one that drops the payload in the kernel; in turns. And a monitor of a topic that nobody publishes:
what is not the images'. Writes results/bench/large_messages.csv.
"""
import itertools
import re
import sys
import time
from typing import Dict, List

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from tqdm import tqdm

from graph import BENCH, MONITOR, PATIENCE_S, Graph, ask_to_leave, write_som
from report import Goals, arguments, print_table, write_table
from shsa_testing.waiting import wait_until
from substitute_cost import cpu_time

TOPIC, NODE, PERIOD_S = "/image", "/large_source", 1.0 / 30.0
SIZES_B = (100_000, 1_000_000, 6_000_000)
GOAL_B, GOAL_PERCENT = 1_000_000, 1.5
SETTLING_TIME_S, RUN_S, SHORT_RUN_S = 4.0, 10.0, 4.0
UNJUDGED = {"field": "height", "checks": {"not_a_number": False, "stuck": False}}
COPYING = """
from functools import partial
from shsa_core.ros import monitor
from shsa_core.ros.reader import ALL, event_of
monitor.event_of = partial(event_of, unjudged=ALL)
monitor.main()
"""
NOTHING, COPIES, DROPS = "nothing comes", "copied", "dropped"
COLUMNS = ("mode", "bytes", "round", "rate_hz", "monitor_cpu_percent")


def measure(graph: Graph, mode: str, size: int, seconds: float) -> Dict[str, float]:
    """One run: how often messages came to the monitor in Hz, and its share of a core in percent."""
    camera: Dict[str, object] = dict(topic=TOPIC, type="sensor_msgs/Image", node=NODE)
    camera.update(period=PERIOD_S, provides={"picture": UNJUDGED})
    path = write_som(graph.folder / "som.yaml", [camera])
    source = None
    if mode != NOTHING:
        source = graph.python(BENCH / "large_source.py", TOPIC, str(size), str(PERIOD_S))
    script = graph.folder / "copying.py"
    script.write_text(COPYING)
    monitor = graph.python(script if mode == COPIES else MONITOR, "--som", str(path))
    rates: List[float] = []

    def heard(message: DiagnosticArray) -> None:
        told = (value.value for row in message.status for value in row.values if value.key == NODE)
        found = (re.search(r"([0-9.]+) Hz", each) for each in told)
        rates.extend(float(each.group(1)) for each in found if each)

    subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, heard)
    try:
        if source is not None:
            wait_until(lambda: any(rate > 1.0 for rate in rates), PATIENCE_S, "images come")
        time.sleep(SETTLING_TIME_S)
        rates.clear()
        before, begin = cpu_time(monitor.pid), time.monotonic()
        time.sleep(seconds)
        share = (cpu_time(monitor.pid) - before) / (time.monotonic() - begin)
    finally:
        subscriber.unregister()
        for process in (monitor, source):
            if process is not None:
                ask_to_leave(process)
    return {"rate": float(np.median(rates)) if rates else 0.0, "percent": 100.0 * share}


def main() -> int:
    """Measure, print and judge."""
    options = arguments(str(__doc__), "rounds", 3, short="once, images of 1 MB")
    rounds, sizes, seconds = options.rounds, list(SIZES_B), RUN_S
    if options.short:
        rounds, sizes, seconds = 1, [GOAL_B], SHORT_RUN_S
    cases = [(NOTHING, 0), *itertools.product((COPIES, DROPS), sizes)]
    rows = []
    with Graph() as graph:
        for number, (mode, size) in tqdm([*itertools.product(range(rounds), cases)]):
            found = measure(graph, mode, size, seconds)
            rows.append((mode, size, number + 1, found["rate"], round(found["percent"], 2)))
    write_table(options.results / "large_messages.csv", COLUMNS, rows)
    shares = {case: np.median([row[4] for row in rows if row[:2] == case]) for case in cases}
    rates = {case: np.median([row[3] for row in rows if row[:2] == case]) for case in cases}
    print_table(
        "The monitor's share of a core, %: medians",
        ("", "bytes", "Hz", "%"),
        [(c[0], str(c[1]), f"{rates[c]:.1f}", f"{shares[c]:.2f}") for c in cases],
    )
    goals = Goals()
    share = float(shares[DROPS, GOAL_B])
    goals.at_most("1 MB at 30 Hz watched", "monitor", GOAL_PERCENT, share, "%")
    goals.show(options.results / "large_messages_goals.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())

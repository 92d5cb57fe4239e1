"""A gate between a failing node and its consumers: what they hear, and what the gate costs.

A node fails again and again in seeded ways (values, stamps, steps, silence, lateness, too fast; see
gate_source.py); a substitute publishes beside it. One consumer in rospy and one in roscpp hear both
topics, so that what the gate adds to each message's way is measured beside the direct way; so is
the longest gap: the substitute never fails, and its own gap is the computer's and the consumer's.
Writes gated.csv (a row a consumer), gated_goals.csv and gated.png.
"""
import argparse
import math
import sys
import time
from pathlib import Path
from typing import List

import matplotlib.pyplot as plt
import psutil
from shsa_msgs import msg

from gate_source import JUMPED, OLD
from graph import FAULTY_PUBLISHER, GATE_PROGRAM, PATIENCE_S, Graph
from report import Goals, in_words, print_table, summary, write_table
from robot import Consumer, Consumers
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.messages.tables import TablePublisher
from shsa_core.ros.wire import names
from shsa_testing.waiting import wait_until

RAW, HEARD, PERIOD_S = "/gated/raw", "/gated", 0.02
SOURCE = Path(__file__).with_name("gate_source.py")
LOW, HIGH, STANDS_IN = 0.0, 160000.0, 150000.0
SOM = f"""\
act: true
services:
  gated:
    topic: {HEARD}
    gate: {RAW}
    type: shsa_msgs/Float64Stamped
    node: /source
    period: {PERIOD_S}
    checks: {{stale_stamp: 1.0}}
    provides:
      value: {{field: data, range: [{LOW}, {HIGH}], checks: {{jump: 10000, stuck: false}}}}
"""
COLUMNS = (
    *("consumer", "messages", "bad", "longest_gap_ms", "gaps_over_goal", "direct_gap_ms"),
    *("added_p50_ms", "added_p95_ms", "added_max_ms", "gate_cpu_percent"),
)
GOAL_GAP, GOAL_MS = 2.0, 0.5


def is_bad(value: float) -> bool:
    """Return whether nobody should have heard a value."""
    return not (math.isfinite(value) and LOW <= value <= HIGH) or value in (JUMPED, OLD)


def added(consumer: Consumer) -> List[float]:
    """By how many ms each message of the node came later through the gate than directly."""
    heard = list(consumer.messages)
    direct = {m.value: m.at for m in heard if m.topic == RAW and m.node == "/source"}
    through = (m for m in heard if m.topic == HEARD and m.value in direct)
    return [1e3 * (m.at - direct[m.value]) for m in through if not is_bad(m.value)]


def gaps(consumer: Consumer, topic: str, since: float, until: float, node: str = "") -> List[float]:
    """Return the pauses of a topic in a time, or of one node on it; in ms."""
    heard = [m for m in consumer.since(since) if m.topic == topic and m.at < until]
    times = [m.at for m in heard if node in ("", m.node)]
    return [1e3 * (b - a) for a, b in zip(times, times[1:])]


def table(secret: str) -> TablePublisher:
    """Return the signed table that names the substitute, as the reconfigurator sends it."""
    shown = TablePublisher(
        names.SUBSTITUTIONS,
        msg.Substitutions,
        "substitutions",
        lambda row: str(row.node),
        Signing(secret),
    )
    output = msg.Signal(topic=RAW, field="data", type="shsa_msgs/Float64Stamped", period=PERIOD_S)
    row = msg.Substitution(node="/stand_in", service="gated", code="y=0", outputs=[output])
    row.gated = True
    shown.update([row])
    return shown


def main() -> int:
    """Measure, then say the verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=3000, help="faults")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--short", action="store_true", help="a fault of each kind, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    count = 9 if options.short else options.count
    with Graph() as graph:
        som, secret = graph.folder / "som.yaml", str(graph.folder / "secret")
        som.write_text(SOM)
        substitutions = table(secret)
        process = graph.python(GATE_PROGRAM, "gated", "--som", str(som), "--secret", secret)
        stand_in = ("__name:=stand_in", f"_topic:={RAW}", f"_value:={STANDS_IN}")
        graph.python(FAULTY_PUBLISHER, *stand_in, f"_period:={PERIOD_S}")
        consumers = Consumers(graph, HEARD, RAW)
        hears = lambda topic: all(any(m.topic == topic for m in c.messages) for c in consumers)
        wait_until(lambda: hears(RAW) and hears(HEARD), PATIENCE_S, "the substitute")
        source = graph.python(SOURCE, str(count), str(options.seed), str(PERIOD_S))
        believed = lambda c: any(
            m.topic == HEARD and m.node and 50 < m.value < 1e5 for m in c.messages
        )
        wait_until(lambda: all(map(believed, consumers)), PATIENCE_S, "the node")
        since = time.monotonic()
        used = psutil.Process(process.pid).cpu_times()
        wait_until(lambda: source.poll() is not None, 10.0 + count, "the last fault")
        until, now = time.monotonic(), psutil.Process(process.pid).cpu_times()
        share = 100.0 * (sum(now[:2]) - sum(used[:2])) / (until - since)
        substitutions.update([], ["/stand_in"])
        rows, goals, figures = [], Goals(), []
        for name, consumer in (("rospy", consumers.rospy), ("roscpp", consumers.roscpp)):
            bad = sum(m.topic == HEARD and is_bad(m.value) for m in list(consumer.messages))
            found = gaps(consumer, HEARD, since, until)
            limit, gap = GOAL_GAP * 1e3 * PERIOD_S, max(found)
            over = sum(each > limit for each in found)
            direct = max(gaps(consumer, RAW, since, until, "/stand_in"))
            late = added(consumer)
            p50, p95, most = summary(late)
            figures.append((name, late))
            rows.append((name, len(found), bad, gap, over, direct, p50, p95, most, share))
            goals.at_most("bad messages heard", name, 0, bad, "")
            goals.at_most("longest gap", name, limit, gap, "ms")
            goals.at_most("p50 of the latency that the gate adds", name, GOAL_MS, p50, "ms")
        consumers.end()
    columns = (
        *("", "messages", "bad", "longest gap", f"over {GOAL_GAP:g} periods", "substitute's own"),
        *("added: median / p95 / max", "gate's CPU, %"),
    )
    shown = [
        (
            *(name, str(messages), str(bad), f"{gap:.1f}", str(over), f"{direct:.1f}"),
            *(in_words(late, 2), f"{share:.1f}"),
        )
        for (name, messages, bad, gap, over, direct, *_), (_, late) in zip(rows, figures)
    ]
    print_table(f"{count} faults at {1 / PERIOD_S:g} Hz; times in ms", columns, shown)
    write_table(options.results / "gated.csv", COLUMNS, rows)
    goals.show(options.results / "gated_goals.csv")
    figure, axis = plt.subplots(figsize=(7, 4))
    for name, late in figures:
        axis.step(sorted(late), [i / len(late) for i in range(len(late))], label=name)
    axis.set_xlabel("added by the gate, ms")
    axis.set_ylabel("share of messages below")
    axis.grid(True, alpha=0.3)
    axis.legend()
    figure.tight_layout()
    figure.savefig(str(options.results / "gated.png"), dpi=120)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The time that two publishers are heard when an original returns, and gaps.

A node is ended, its substitute publishes, and somebody starts the node again, many times. Two
consumers listen side by side, one in rospy and one in roscpp. Of each return:

overlap: from the original's first message to the substitute's last one, as a consumer hears them;
above one period the two were heard together. gap: the longest pause from one second before the
original's first message to one second after it. Writes returns.csv and returns_goals.csv.
"""
import argparse
import csv
import random
import sys
import time
from pathlib import Path
from typing import Dict, List, Sequence, Tuple

from tqdm import tqdm

from graph import Graph
from report import Goals, in_words, print_table
from robot import NODE, PATIENCE_S, TOPIC, Consumer, Consumers, HealthyRobot
from shsa_testing.graph import kill_hard
from shsa_testing.waiting import wait_until

PERIOD_S = 0.02
AROUND_S = 1.0
COLUMNS = ("standby", "consumer", "overlap_ms", "messages", "gap_ms")
Return = Tuple[float, int, float]


def returned(consumer: Consumer, since: float) -> Return:
    """Overlap in ms, how many messages of it came after one period, and the gap in ms."""
    heard = consumer.since(since)
    first = next(each.at for each in heard if each.node == NODE)
    others = [each.at - first for each in heard if each.node != NODE]
    near = [each.at for each in heard if abs(each.at - first) < AROUND_S]
    gap = max(later - at for at, later in zip(near, near[1:]))
    together = sum(at > PERIOD_S for at in others)
    return 1e3 * max(0.0, *others), together, 1e3 * gap


def come_and_go(robot: HealthyRobot, consumers: Consumers) -> Dict[str, Return]:
    """End the node, and start it again once its substitute is heard."""
    robot.await_well()
    time.sleep(random.random() * PERIOD_S)
    kill_hard(NODE)
    incident = robot.healing.await_state(TOPIC, "healed", PATIENCE_S)
    since = time.monotonic()
    consumers.await_node(incident.substitute, since)
    robot.bring_back()
    consumers.await_node(NODE, since)
    robot.healing.await_state(TOPIC, "ended", PATIENCE_S)
    first = min(each.at for c in consumers for each in c.since(since) if each.node == NODE)
    wait_until(lambda: time.monotonic() > first + 2 * AROUND_S, PATIENCE_S, "two seconds")
    return {"rospy": returned(consumers.rospy, since), "roscpp": returned(consumers.roscpp, since)}


def show(rows: Dict[Tuple[str, str], List[Return]]) -> None:
    """Print how many returns were heard twice, and for how long."""
    words: List[Sequence[str]] = []
    for (standby, consumer), returns in rows.items():
        overlaps, messages, gaps = zip(*returns)
        above = sum(count > 0 for count in messages)
        figures = (in_words(overlaps), str(sum(messages)), in_words(gaps))
        words.append((f"{standby}, {consumer}", f"{above} of {len(returns)}", *figures))
    columns = ("", "above one period", "overlap, ms", "messages after it", "gap, ms")
    print_table("Returns of an original: median / p95 / max", columns, words)


def main() -> int:
    """Measure; 1 if a failure was not healed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--returns", type=int, default=100, help="returns of each standby")
    parser.add_argument("--only", nargs="+", default=["hot", "warm"], help="cold, warm, hot")
    parser.add_argument("--short", action="store_true", help="twice, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    rows: Dict[Tuple[str, str], List[Return]] = {}
    with Graph() as graph, open(options.results / "returns.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        consumers = Consumers(graph, TOPIC)
        for standby in options.only:
            robot = HealthyRobot(graph, consumers, standby, PERIOD_S)
            for _ in tqdm(range(2 if options.short else options.returns), standby, disable=None):
                for name, found in come_and_go(robot, consumers).items():
                    rows.setdefault((standby, name), []).append(found)
                    writer.writerow([standby, name, f"{found[0]:.3f}", found[1], f"{found[2]:.3f}"])
                file.flush()
            robot.end()
    show(rows)
    goals = Goals()
    for (standby, consumer), returns in rows.items():
        longest = max(overlap for overlap, _, _ in returns)
        goals.at_most(f"{standby}: overlap, one period", consumer, 1e3 * PERIOD_S, longest, "ms")
    goals.show(options.results / "returns_goals.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())

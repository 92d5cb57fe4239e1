"""The time that two publishers are heard when an original returns, and gaps.

A node is ended, its substitute publishes, and somebody starts the node again, many times. Two
consumers listen side by side, one in rospy and one in roscpp. Of each return:

overlap: from the original's first message to the substitute's last one, as a consumer hears them;
above one period the two were heard together. gap: the longest pause from one second before the
original's first message to one second after it; apart: the least time there between a message of
one and the next of the other. Writes returns.csv and returns_goals.csv.
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
COLUMNS = ("standby", "consumer", "overlap_ms", "messages", "gap_ms", "apart_ms")
Return = Tuple[float, int, float, float]


def returned(consumer: Consumer, since: float) -> Return:
    """Overlap in ms, how many messages of it came after one period, gap and distance in ms."""
    heard = consumer.since(since)
    first = next(each.at for each in heard if each.node == NODE)
    others = [each.at - first for each in heard if each.node != NODE]
    near = [each for each in heard if abs(each.at - first) < AROUND_S]
    pairs = list(zip(near, near[1:]))
    gap = max(later.at - each.at for each, later in pairs)
    apart = min(later.at - each.at for each, later in pairs if each.node != later.node)
    together = sum(at > PERIOD_S for at in others)
    return 1e3 * max(0.0, *others), together, 1e3 * gap, 1e3 * apart


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
        overlaps, messages, gaps, aparts = zip(*returns)
        above = sum(count > 0 for count in messages)
        holes = sum(gap > 2e3 * PERIOD_S for gap in gaps)
        close = sum(apart < 500 * PERIOD_S for apart in aparts)
        figures = (in_words(overlaps), str(sum(messages)), in_words(gaps), str(holes), str(close))
        words.append((f"{standby}, {consumer}", f"{above} of {len(returns)}", *figures))
    more = "gap, ms", "gaps above two", "closer than half"
    columns = ("", "above one period", "overlap, ms", "messages after it", *more)
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
                    figures = (found[0], found[2], found[3])
                    overlap, gap, apart = (f"{figure:.3f}" for figure in figures)
                    writer.writerow([standby, name, overlap, found[1], gap, apart])
                file.flush()
            robot.end()
    show(rows)
    goals = Goals()
    for (standby, consumer), returns in rows.items():
        longest = max(found[0] for found in returns)
        goals.at_most(f"{standby}: overlap, one period", consumer, 1e3 * PERIOD_S, longest, "ms")
    goals.show(options.results / "returns_goals.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())

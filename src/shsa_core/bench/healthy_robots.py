"""Healthy life of three robots in simulated time: is anybody killed, replaced or blamed for it?

    python3 healthy_robots.py [--hours H] [--seed N] [--short] [--results DIR]

A base, an arm and a drone live for H hours each, and rosbags of them are played more slowly and
faster: see shsa_testing.healthy_robots. Writes healthy_robots.csv and healthy_robots_goals.csv;
ends with status 1 if anything was done to a healthy node.
"""
import argparse
import sys
from pathlib import Path
from typing import List, NamedTuple

from tqdm import tqdm

from report import Goals, print_table, write_table
from shsa_testing.healthy_robots import RATES, ROBOTS, HealthyRobot

FILES = Path(__file__).resolve().parent.parent / "test" / "data"
STEP_S = 60.0


class Row(NamedTuple):
    """What happened to a robot; `rate`: of the rosbag that is played, 1 of a robot that lives.

    `failures`: incidents that told of nodes that were gone; the last three are to be 0.
    """

    robot: str
    rate: float
    hours: float
    messages: int
    restarts: int
    failures: int
    killed: int
    replaced: int
    blamed: int


def main() -> int:
    """Measure, print the verdict, write the CSV files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0, help="of each robot's life")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--short", action="store_true", help="for a simulated minute, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    hours = 1.0 / 60.0 if options.short else options.hours
    options.results.mkdir(parents=True, exist_ok=True)
    rows: List[Row] = []
    for name in ROBOTS:
        for rate in RATES:
            robot = HealthyRobot(name, FILES, options.seed, rate)
            what = f"{name}, rosbag at {rate:g}" if rate else name
            steps = max(1, round(3600.0 * hours / STEP_S))
            for _ in tqdm(range(steps), desc=what, disable=None):
                found = robot.run(3600.0 * hours / steps)
            for told in (*found.kills, *found.takeovers, *found.incidents):
                print(f"{what}: {told}")
            seen = robot.messages, robot.restarts, robot.incidents - len(found.incidents)
            rows.append(Row(name, rate or 1.0, hours, *seen, *map(len, found)))
    print_table("Healthy robots", Row._fields, [[f"{each}" for each in row] for row in rows])
    write_table(options.results / "healthy_robots.csv", Row._fields, rows)
    goals = Goals()
    for what in ("killed", "replaced", "blamed"):
        for name in ROBOTS:
            count = sum(getattr(row, what) for row in rows if row.robot == name)
            goals.at_most(f"healthy robots: {what}", name, 0, count, "")
    goals.show(options.results / "healthy_robots_goals.csv")
    return int(any(row.killed or row.replaced or row.blamed for row in rows))


if __name__ == "__main__":
    sys.exit(main())

"""Healthy life of three robots in simulated time: is anybody killed, replaced or blamed for it?

    python3 healthy_robots.py [--hours H] [--seed N] [--short] [--results DIR]

A base, an arm and a drone live for H hours each, and rosbags of them are played more slowly and
faster: see shsa_testing.healthy_robots. Writes healthy_robots.csv and healthy_robots_goals.csv;
ends with status 1 if anything was done to a healthy node.
"""
import argparse
import sys
from pathlib import Path
from typing import Any, List, NamedTuple, Sequence

from tqdm import tqdm

from report import Goals, print_table, write_table
from shsa_testing.healthy_robots import LIVES, ROBOTS, HealthyRobot

FILES = Path(__file__).resolve().parent.parent / "test" / "data"
STEP_S = 60.0
DONE = ("killed", "replaced", "blamed")
"""Columns of what is not to be done to a healthy node."""


class Row(NamedTuple):
    """What happened to a robot; `rate`: of the rosbag that is played, 1 of a robot that lives.

    `failures`: incidents that told of nodes that were gone; the last three are to be 0.
    """

    robot: str
    rate: float
    clock: bool
    hours: float
    messages: int
    restarts: int
    failures: int
    killed: int
    replaced: int
    blamed: int


def verdict(name: str, rows: Sequence[Any], results: Path) -> int:
    """Print what was done to robots, and write it; return 1 if it was done to a healthy node."""
    columns, title = rows[0]._fields, name.replace("_", " ")
    print_table(title.capitalize(), columns, [[f"{each}" for each in row] for row in rows])
    write_table(results / f"{name}.csv", columns, rows)
    goals = Goals()
    for what in DONE:
        for robot in ROBOTS:
            count = sum(getattr(row, what) for row in rows if row.robot == robot)
            goals.at_most(f"{title}: {what}", robot, 0, count, "")
    goals.show(results / f"{name}_goals.csv")
    return int(any(getattr(row, what) for row in rows for what in DONE))


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
        for rate, clock in LIVES:
            robot = HealthyRobot(name, FILES, options.seed, rate, clock)
            what = f"{name}, rosbag at {rate:g}" if rate else name
            steps = max(1, round(3600.0 * hours / STEP_S))
            for _ in tqdm(range(steps), desc=what, disable=None):
                found = robot.run(3600.0 * hours / steps)
            for told in (*found.kills, *found.takeovers, *found.incidents):
                print(f"{what}: {told}")
            seen = robot.messages, robot.restarts, robot.incidents - len(found.incidents)
            rows.append(Row(name, rate or 1.0, clock, hours, *seen, *map(len, found)))
    return verdict("healthy_robots", rows, options.results)


if __name__ == "__main__":
    sys.exit(main())

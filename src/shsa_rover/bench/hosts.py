"""The current at a consumer on the mainboard when the Raspberry Pi or its link fails.

The rover runs on three computers made of namespaces, healed from the notebook; deadline: the SOM's.
Of each repetition: `outage_ms`, the longest pause between fresh messages; `lost`, messages that the
consumer missed, counted by their numbers, and where the publisher changed by the pause; `late`,
messages of the amperemeter that were older than the deadline as they came; `taken`, how many of
them came while it was the publisher by healing's word, and `taken_age_ms`, how old the oldest of
these was; `delayed`, messages of substitutes that were as old, as where the computer has too much
to do; `publishers` that are heard once the dust has settled, and `two_heard_ms`, for how long two
were heard with fresh messages; `ended`, nodes that healing ended though only their link was bad.

Writes hosts.csv, hosts_goals.csv and hosts.png. Needs the right to make namespaces.
"""
import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Dict, Iterator, List, Tuple

import matplotlib.pyplot as plt
from tqdm import tqdm

from hosts_row import DEADLINE_S, PERIOD_S, ROWS, Outcome
from report import Goals, arguments, in_words, print_table, summary
from shsa_testing.computers import refusal

MISSES = 3
ONE_ROW = Path(__file__).with_name("hosts_row.py")


def repetitions(name: str, count: int) -> Iterator[Outcome]:
    """Measure a row, by a new rover after each miss, with fewer where there are too many."""
    missed = done = 0
    while done < count and missed < MISSES:
        command = [sys.executable, str(ONE_ROW), name, str(count - done)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            for line in process.stdout:
                done += 1
                yield Outcome(**json.loads(line))
        missed += process.returncode != 0


def judge(rows: Dict[str, List[Outcome]]) -> Goals:
    """Return the goals."""
    goals = Goals()
    for name, outcomes in rows.items():
        if outcomes:
            of = lambda field: [getattr(each, field) for each in outcomes]
            goals.at_most(f"{name}: stale messages accepted", "rospy", 0, max(of("taken")), "")
            goals.at_most(f"{name}: publishers", "rospy", 1, max(of("publishers")), "")
            ended = sum(len(each.split()) for each in of("ended"))
            goals.at_most(f"{name}: nodes ended that were well", "rospy", 0, ended, "")
            if "hot" in name:
                p95 = summary(of("outage_ms"))[1]
                goals.at_most(f"{name}: p95, 2 periods", "rospy", 2e3 * PERIOD_S, p95, "ms")
    return goals


def show(rows: Dict[str, List[Outcome]]) -> None:
    """Print the table."""
    columns = (
        *("", "n", "outage, ms", "lost", "late"),
        *(
            "late, taken",
            "oldest taken, ms",
            "delayed",
            "publishers",
            "two heard, ms",
            "incidents",
            "ended",
        ),
    )
    table: List[Tuple[str, ...]] = []
    for name, outcomes in rows.items():
        of = lambda field: [getattr(each, field) for each in outcomes]
        table.append(
            (
                name,
                str(len(outcomes)),
                in_words(of("outage_ms"), 0),
                in_words(of("lost"), 0),
                in_words(of("late"), 0),
                str(max(of("taken"), default="")),
                f"{max(of('taken_age_ms'), default=0.0):.0f}",
                str(max(of("delayed"), default="")),
                str(max(of("publishers"), default="")),
                in_words(of("two_heard_ms"), 0),
                in_words(of("incidents"), 0),
                str(sum(len(each.split()) for each in of("ended"))),
            )
        )
    print_table("At a consumer on the mainboard: median / p95 / max", columns, table)


def plot(rows: Dict[str, List[Outcome]], path: Path) -> None:
    """Draw the outages, the first row on top."""
    names = [name for name, outcomes in rows.items() if outcomes][::-1]
    if not names:
        return
    figure, axes = plt.subplots(figsize=(9, 1.5 + 0.5 * len(names)), constrained_layout=True)
    axes.boxplot(
        [[each.outage_ms for each in rows[name]] for name in names], vert=False, whis=(5, 95)
    )
    axes.set_yticklabels([f"{name} ({len(rows[name])})" for name in names])
    axes.axvline(1e3 * DEADLINE_S, linestyle="--", color="tab:gray", label="deadline")
    axes.set_xscale("log")
    axes.grid(True, axis="x", which="both", alpha=0.3)
    axes.set_xlabel("outage at the mainboard, ms: quartiles, whiskers at 5 and 95 %")
    axes.legend()
    figure.savefig(str(path), dpi=120)
    plt.close(figure)


def main() -> int:
    """Measure every row; 1 if a failure was not healed."""
    options = arguments(str(__doc__), "repetitions", 20, short="two of each row")
    reason = refusal()
    if reason:
        print(f"Not measured, {', '.join(row.name for row in ROWS)}: {reason}")
        return 0
    wanted = [row for row in ROWS if any(part in row.name for part in options.only)]
    count = 2 if options.short else options.repetitions
    rows: Dict[str, List[Outcome]] = {row.name: [] for row in wanted}
    with open(str(options.results / "hosts.csv"), "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("row", "number", *Outcome._fields))
        for name in rows:
            for outcome in tqdm(repetitions(name, count), name, count, disable=None):
                rows[name].append(outcome)
                writer.writerow((name, len(rows[name]), *outcome))
                file.flush()
    show(rows)
    plot(rows, options.results / "hosts.png")
    judge(rows).show(options.results / "hosts_goals.csv")
    return 1 if any(len(each) < count for each in rows.values()) else 0


if __name__ == "__main__":
    sys.exit(main())

"""The outage at a consumer when a node fails, with substitutes and without healing.

Every fault that ends in silence is measured with a hot substitute, with `bridge` and without, and
beside it what ROS alone does, `respawn="true"`; the crash with warm and cold ones as well, and
beside rosmon where ROS_PACKAGE_PATH has it.

An outage is the longest pause between two good messages, from the last one before a failure until
the topic is as it was, by the monotonic clock of the consumer: so it is never below a period. What
the steps add up to is the silence before the substitute's first message. A fault that nobody
answers is watched for 5 s, and its outage is `never` over if nothing came any more; `over` is when
the topic was as it was. Two consumers listen side by side, one in rospy and one in roscpp. Writes
failover.csv (every failure with every step), failover_goals.csv and failover.png.
"""
import csv
import random
import sys
import time
from pathlib import Path
from typing import Callable, Dict, List, Sequence, Tuple

import rospkg
from tqdm import tqdm

from contenders import WAITED_S, ByHand, Contender, Healed, Respawned, repeat
from failover_plot import plot
from failover_rows import (
    BEHIND_GATE,
    BY_HAND,
    BY_NAME,
    HOT,
    NO_BRIDGE,
    RESPAWNED,
    ROSMON,
    ROWS,
    SHORT,
    UNANSWERED,
    Row,
)
from faults import FAULTS, SILENT
from graph import Graph
from report import Goals, arguments, in_words, print_table, summary
from robot import SILENCE_S, TOPIC, Applications, Consumers
from takeover import STEPS, Takeover, from_words

COLUMNS = ("row", "number", *Takeover._fields)
SHORT_WAIT_S = 1.0
SILENCES = {"hot": (18.0, 28.0), "warm": (27.0, 35.0)}
"""After `kill -9`, at most until the substitute's first message in ms: median, 95th percentile."""
ROSMON_PROGRAM = ("rosrun", "rosmon_core", "rosmon", "--disable-ui")
Takeovers = Dict[str, List[Takeover]]
"""By the name of the row."""


def fail(contender: Contender) -> Takeover:
    """Fail at a random moment of the period, once everything is well."""
    contender.await_well()
    time.sleep(random.random() * contender.period)
    return contender.fail()


def judge(rows: Takeovers) -> Goals:
    """Return the goals, at each consumer."""
    goals = Goals()
    for name, limits in SILENCES.items():
        found = [each.silence_ms for each in rows.get(name, ())]
        for which, limit, figure in zip(("median", "p95"), limits, summary(found)):
            if found:
                goal = f"{name}: {which} until the first message"
                goals.at_most(goal, "rospy", limit, figure, "ms")
    for consumer in ("rospy", "roscpp"):

        def figures(row: Row) -> Sequence[float]:
            found = rows.get(row.name, ())
            return summary([getattr(each, consumer + "_ms") for each in found])

        def at_most(row: Row, limit: float, what: str) -> None:
            if rows.get(row.name):
                goals.at_most(f"{row.name}: p95, {what}", consumer, limit, figures(row)[1], "ms")

        def ratio(row: Row, other: Row, limit: float) -> None:
            if rows.get(row.name) and rows.get(other.name):
                share = figures(row)[0] / figures(other)[0]
                goal = f"{row.name} / {other.name}: medians"
                goals.at_most(goal, consumer, limit, share, "")

        at_most(Row(HOT), 28.0, "1 period + 8 ms")
        for fault in SILENT[1:]:
            at_most(Row(HOT, fault), 60.0, "3 periods")
        for fault in FAULTS:
            row = Row(HOT, fault, som=BEHIND_GATE)
            at_most(row, 40.0, "2 periods")
            if rows.get(row.name):
                bad = sum(getattr(each, consumer + "_bad") for each in rows[row.name])
                goals.at_most(f"{row.name}: bad messages", consumer, 0.0, bad, "")
        deadline = 1e3 * SILENCE_S + 30.0
        at_most(Row(HOT, "SIGSTOP", som=NO_BRIDGE), deadline, "the deadline and 1.5 periods")
        at_most(Row(HOT, period=0.01), 20.0, "2 periods")
        at_most(Row("warm"), 50.0, "50 ms")
        ratio(Row("cold"), Row(BY_HAND), 1.2)
        ratio(Row(HOT), Row("respawn, rospy"), 1 / 10)
        ratio(Row("warm"), Row("respawn, rospy"), 1 / 6)
        ratio(Row(HOT), Row("respawn, roscpp"), 1 / 3)
        for count in (100, 500):
            at_most(Row(HOT, applications=count), 30.0, "1.5 periods")
    return goals


def show(rows: Takeovers, markdown: bool) -> None:
    """Print the outages, and the medians of the steps."""
    heads = ("rospy consumer", "roscpp consumer", "over", "bad messages", "late messages")
    outages: List[Tuple[str, ...]] = []
    steps: List[Tuple[str, ...]] = []
    digits = 0 if markdown else 1
    for name, takeovers in rows.items():
        of = lambda field: [getattr(each, field) for each in takeovers]
        title = BY_NAME[name].title if markdown else name
        outages.append(
            (
                title,
                str(len(takeovers)),
                *(in_words(of(f"{each}_ms"), digits) for each in ("rospy", "roscpp", "over")),
                str(max(of("rospy_bad") + of("roscpp_bad"), default=0)),
                str(max(of("late"), default=0)),
            )
        )
        if takeovers and not FAULTS[BY_NAME[name].fault].eased and takeovers[0].substitute:
            medians = [f"{summary(of(step + '_ms'))[0]:.1f}" for step in STEPS]
            steps.append((title, *medians, in_words(of("silence_ms"), digits)))
    print_table(
        "Outage at a consumer, ms: median / p95 / max", ("", "n", *heads), outages, markdown
    )
    if steps:
        title = "Steps until the first message at the rospy consumer, ms: medians"
        print_table(title, ("", *STEPS, "all of them"), steps, markdown)


def show_goals(goals: Goals) -> None:
    """Print the goals in Markdown, a line for both consumers."""
    lines: Dict[str, List[str]] = {}
    for goal, _, limit, figure, verdict in goals.rows:
        found = figure if verdict == "met" else f"{figure}, not met"
        lines.setdefault(goal, [goal, limit]).append(found)
    columns = ("goal", "at most", "rospy consumer", "roscpp consumer")
    print_table("Goals", columns, lines.values(), markdown=True)


def read(path: Path) -> Takeovers:
    """Read the results of an earlier run. Raises SystemExit if they cannot be read."""
    rows: Takeovers = {row.name: [] for row in ROWS}
    try:
        with open(path, newline="") as file:
            for line in csv.DictReader(file):
                rows[line["row"]].append(from_words(line))
    except (OSError, KeyError, ValueError) as error:
        raise SystemExit(f"{path} holds no rows of this version: {error!r}; measure anew") from None
    return {name: takeovers for name, takeovers in rows.items() if takeovers}


class Bench:
    """Two consumers, as many application nodes as a row wants, and what fails beside them."""

    def __init__(self, graph: Graph, patience: float) -> None:
        self._graph = graph
        self._patience = patience
        self._consumers = Consumers(graph, TOPIC)
        self._applications = Applications(graph, rate=0.0)

    def measure(self, row: Row, count: int, note: Callable[[Takeover], None]) -> int:
        """Note a row's failures; how many were not healed in time."""
        self._applications.grow(row.applications)
        noted = 0
        progress = tqdm(total=count, desc=f"{row.name:24}", disable=None)

        def once(contender: Contender) -> None:
            nonlocal noted
            note(fail(contender))
            noted += 1
            progress.update()

        misses = repeat(self._graph, lambda: self._make(row), once, lambda: noted >= count)
        progress.close()
        return misses

    def _make(self, row: Row) -> Contender:
        graph, consumers, fault = self._graph, self._consumers, FAULTS[row.fault]
        if row.is_healed:
            return Healed(graph, consumers, row.help, row.period, fault, **row.som)
        if row.help == BY_HAND:
            return ByHand(graph, consumers)
        program = ROSMON_PROGRAM if row.help == ROSMON else ("roslaunch",)
        return Respawned(graph, consumers, RESPAWNED[row.help], fault, self._patience, program)


def wanted(only: Sequence[str], short: bool) -> List[Row]:
    """Return the rows that are asked for, those without other nodes first."""
    rows = [row for row in ROWS if any(part in row.name for part in only)]
    if short:
        rows = [row for row in ROWS if row.name in SHORT]
    for row in rows:
        for key in row.unknown:
            print(f"Left out: {row.name}. The SOM of this version does not know `{key}`.")
    known = [row for row in rows if not row.unknown]
    if Row(ROSMON) in known and "rosmon_core" not in rospkg.RosPack().list():
        print(f"Left out: {ROSMON}. There is no rosmon on ROS_PACKAGE_PATH.")
        known = [row for row in known if row.help != ROSMON]
    return sorted(known, key=lambda row: row.applications)


def main() -> int:
    """Measure every row; 1 if a failure was not healed in time."""
    options = arguments(
        str(__doc__),
        *("failures", 50),
        short="once hot, by respawn and by hand",
        redraw="measure nothing: tables and picture of failover.csv",
        markdown="the same, and tables as docs/explanation/experiments.md has them",
    )
    misses = 0
    path = options.results / "failover.csv"
    if not options.redraw and not options.markdown:
        rows = wanted(options.only, options.short)
        with Graph() as graph, open(path, "w", newline="") as file:
            bench = Bench(graph, SHORT_WAIT_S if options.short else WAITED_S)
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            for row in rows:
                number = 0

                def note(takeover: Takeover) -> None:
                    nonlocal number
                    number += 1
                    writer.writerow([row.name, number, *takeover.in_words()])
                    file.flush()

                count = 2 if options.short else options.failures
                count = count if row.is_answered else min(count, UNANSWERED)
                misses += bench.measure(row, count, note)
    found = read(path)
    show(found, options.markdown)
    plot(found, options.results / "failover.png")
    goals = judge(found)
    if options.markdown:
        show_goals(goals)
    else:
        goals.show(options.results / "failover_goals.csv")
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())

"""The outage at a consumer when a node fails, with substitutes and without healing.

Substitutes are hot, warm and cold.

An outage lasts from the last good message before a failure to the first one after it, by the
monotonic clock of the consumer. Two consumers listen side by side, one in rospy and one in roscpp.
Writes failover.csv (every failure with every step), failover_goals.csv and failover.png.
"""
import csv
import random
import sys
import time
from typing import Callable, Dict, List, NamedTuple, Sequence, Tuple

from tqdm import tqdm

from contenders import FAULTS, ByHand, Contender, Healed, Respawned, repeat
from failover_plot import plot
from graph import Graph
from report import Goals, arguments, in_words, print_table, summary
from robot import SILENCE_S, TOPIC, Applications, Consumers
from takeover import STEPS, Takeover

COLUMNS = ("row", "number", *Takeover._fields)


class Row(NamedTuple):
    """A row of the table: how the failure is made, and what helps against it."""

    name: str
    standby: str = "hot"
    fault: str = "kill -9"
    period: float = 0.02
    applications: int = 0


HEALED = (
    Row("hot"),
    Row("hot, 100 Hz", period=0.01),
    Row("warm", "warm"),
    Row("cold", "cold"),
    Row("hot, rosnode kill", fault="rosnode kill"),
    Row("hot, SIGSTOP", fault="SIGSTOP"),
    Row("hot, out of range", fault="out of range"),
    Row("hot, 100 other nodes", applications=100),
    Row("hot, 500 other nodes", applications=500),
)
RESPAWNED = {"respawn, rospy": "faulty_publisher", "respawn, roscpp": "bench_talker"}
BY_HAND = "rosrun by hand, rospy"


def fail(contender: Contender) -> Takeover:
    """Fail at a random moment of the period, once everything is well."""
    contender.await_well()
    time.sleep(random.random() * contender.period)
    return contender.fail()


def judge(rows: Dict[str, List[Takeover]]) -> Goals:
    """The goals, at each consumer."""
    goals = Goals()
    for consumer in ("rospy", "roscpp"):

        def figures(name: str) -> Sequence[float]:
            return summary([getattr(each, consumer + "_ms") for each in rows.get(name, ())])

        def at_most(name: str, limit: float, what: str) -> None:
            if rows.get(name):
                goals.at_most(f"{name}: p95, {what}", consumer, limit, figures(name)[1], "ms")

        def ratio(name: str, other: str, limit: float) -> None:
            if rows.get(name) and rows.get(other):
                share = figures(name)[0] / figures(other)[0]
                goals.at_most(f"{name} / {other}: medians", consumer, limit, share, "")

        at_most("hot", 30.0, "1.5 periods")
        at_most("hot, 100 Hz", 20.0, "2 periods")
        at_most("warm", 50.0, "50 ms")
        ratio("cold", BY_HAND, 1.2)
        ratio("hot", "respawn, rospy", 1 / 10)
        ratio("warm", "respawn, rospy", 1 / 6)
        ratio("hot", "respawn, roscpp", 1 / 3)
        at_most("hot, rosnode kill", 30.0, "1.5 periods")
        at_most("hot, SIGSTOP", 1e3 * SILENCE_S + 30.0, "the deadline and 1.5 periods")
        for count in (100, 500):
            at_most(f"hot, {count} other nodes", 30.0, "1.5 periods")
    return goals


def show(rows: Dict[str, List[Takeover]]) -> None:
    """Print the outages, and the medians of the steps."""
    columns = ("", "n", "rospy consumer", "roscpp consumer", "bad messages", "late messages")
    outages: List[Tuple[str, ...]] = []
    steps: List[Tuple[str, ...]] = []
    for name, takeovers in rows.items():
        of = lambda field: [getattr(each, field) for each in takeovers]
        outages.append(
            (
                name,
                str(len(takeovers)),
                in_words(of("rospy_ms")),
                in_words(of("roscpp_ms")),
                str(max(of("rospy_bad") + of("roscpp_bad"), default=0)),
                str(max(of("late"), default=0)),
            )
        )
        if takeovers and takeovers[0].substitute:
            steps.append((name, *(f"{summary(of(step + '_ms'))[0]:.1f}" for step in STEPS)))
    print_table("Outage at a consumer, ms: median / p95 / max", columns, outages)
    print_table("Steps of the outage at the rospy consumer, ms: medians", ("", *STEPS), steps)


def main() -> int:
    """Measure every row; 1 if a failure was not healed in time."""
    options = arguments(str(__doc__), "failures", 50, short="once hot and by hand")
    failures = 2 if options.short else options.failures
    contenders: Dict[str, Callable[[], Contender]] = {}
    misses = 0
    rows: Dict[str, List[Takeover]] = {}
    path = options.results / "failover.csv"
    with Graph() as graph, open(path, "w", newline="") as file:
        consumers = Consumers(graph, TOPIC)
        applications = Applications(graph, rate=0.0)
        writer = csv.writer(file)
        writer.writerow(COLUMNS)

        def healed(row: Row) -> Contender:
            return Healed(graph, consumers, row.standby, row.period, FAULTS[row.fault])

        for row in HEALED:
            contenders[row.name] = lambda row=row: healed(row)  # type: ignore[misc]
        for name, executable in RESPAWNED.items():
            contenders[name] = lambda executable=executable: Respawned(  # type: ignore[misc]
                graph, consumers, executable
            )
        contenders[BY_HAND] = lambda: ByHand(graph, consumers)
        others = {row.name: row.applications for row in HEALED}
        wanted = [name for name in contenders if any(part in name for part in options.only)]
        if options.short:
            wanted = ["hot", BY_HAND]
        for name in sorted(wanted, key=lambda each: others.get(each, 0)):
            applications.grow(others.get(name, 0))
            rows[name] = []
            progress = tqdm(total=failures, desc=f"{name:24}", disable=None)

            def once(contender: Contender) -> None:
                rows[name].append(fail(contender))
                writer.writerow([name, len(rows[name]), *rows[name][-1].in_words()])
                file.flush()
                progress.update()

            enough = lambda: len(rows[name]) >= failures
            misses += repeat(graph, contenders[name], once, enough)
            progress.close()
    show(rows)
    plot(rows, options.results / "failover.png")
    goals = judge(rows)
    goals.show(options.results / "failover_goals.csv")
    return 1 if misses else 0


if __name__ == "__main__":
    sys.exit(main())

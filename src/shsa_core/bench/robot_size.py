"""Cost of the reconfigurator's decisions on robots of 10 to 1000 topics, all needed.

    python3 robot_size.py [--largest N] [--rounds N] [--results DIR]

The pure core between a monitor and a graph that answer at once. Prints processor times and their
ratio to the smallest robot's, and the goals; leaves robot_size.json, .txt, .png and
robot_size_goals.csv.
"""
import argparse
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional

from matplotlib import pyplot
from report import Goals, print_table, summary
from simulated_robot import Robot, lines_of

from shsa_core.healing import events
from shsa_core.model.health import PublisherState
from shsa_core.model.kinds import Standby

Sent = Callable[[Iterable[events.Command]], int]

SIZES = (10, 30, 100, 300, 1000)
STEPS = ("failure", "takeover", "health change", "tick", "plan ahead")
"""Steps that are measured: the event of a failure until its commands are out; all events until
the substitute is seen publishing; a changed row of health; a tick; one plan made ahead."""


class Costs(NamedTuple):
    """The cost of one robot: s of processor time for each step and for the start.

    And for a failure, lines of Python and bytes sent.
    """

    topics: int
    standby: str
    steps: Dict[str, List[float]]
    startup: float
    lines: int
    sent: Optional[float]


def sender() -> Optional[Sent]:
    """Return the counter of bytes that commands send; None where there is no ROS."""
    if find_spec("rospy") is None or find_spec("shsa_msgs") is None:
        return None
    from messages_sent import bytes_of

    return bytes_of


def measure(size: int, standby: Standby, rounds: int, bytes_of: Optional[Sent]) -> Costs:
    """Services fail one after the other, are taken over, and come back."""
    robot = Robot(size, standby)
    services = list(robot.som)
    steps: Dict[str, List[float]] = {step: [] for step in STEPS}
    for number in range(rounds):  # back to back: else the processor's cache would be measured
        robot.time += 100.0
        steps["tick"].append(robot.send(events.Tick(robot.time)))
        bystander = services[number * 7 % size]
        seen = robot.row(bystander.topic, bystander.node, PublisherState.HEALTHY)
        steps["health change"].append(robot.send(events.HealthSeen(robot.time, (seen,))))
    sent: List[int] = []
    for number in range(rounds):
        service = services[number * 7 % size]
        robot.time += 100.0
        robot.said = []
        decided, healed = robot.fail(service.node)
        steps["failure"].append(decided)
        steps["takeover"].append(healed)
        if bytes_of is not None:
            sent.append(bytes_of(robot.said))
        steps["plan ahead"] += robot.plans()
        robot.time += 1.0
        robot.come_back(service.node)
    robot.time += 100.0
    lines = lines_of(lambda: robot.fail(services[0].node))
    mean = sum(sent) / len(sent) if sent else None
    return Costs(size, standby.value, steps, robot.startup, lines, mean)


def rows_of(all_: List[Costs]) -> List[List[str]]:
    """The table: medians and 95th percentiles in us, and ratios to the smallest robot's median."""
    rows = []
    for costs in all_:
        small = next(each for each in all_ if each.standby == costs.standby)
        row = [f"{costs.topics} {costs.standby}"]
        for step in STEPS:
            middle, high, _ = summary(costs.steps[step])
            ratio = middle / summary(small.steps[step])[0]
            row.append(f"{1e6 * middle:.0f} / {1e6 * high:.0f} ({ratio:.1f})")
        per_topic = 1e3 * costs.startup / costs.topics
        row.append(f"{1e3 * costs.startup:.0f} ({per_topic:.2f})")
        row.append(str(costs.lines))
        row.append("-" if costs.sent is None else f"{costs.sent:.0f}")
        rows.append(row)
    return rows


def check(all_: List[Costs], goals: Goals) -> None:
    """The goals: a decision costs what it concerns, not what the robot is large."""
    for standby in dict.fromkeys(each.standby for each in all_):
        own = [each for each in all_ if each.standby == standby]
        small, large = own[0], own[-1]
        size = f"{large.topics} {standby} topics"
        for step in ("failure", "takeover", "health change", "tick"):
            here, there = (summary(each.steps[step])[0] for each in (small, large))
            goals.at_most(f"{step}, {size}", "", 1.0, 1e3 * there, "ms")
            goals.at_most(f"{step}, {size}: times {small.topics}", "", 2.0, there / here, "")
        ratio = large.lines / small.lines
        goals.at_most(
            f"lines of Python a failure, {size}: times {small.topics}", "", 1.0, ratio, ""
        )
        each_topic = [costs.startup / costs.topics for costs in (small, large)]
        ratio = each_topic[1] / each_topic[0]
        goals.at_most(f"start a topic, {size}: times {small.topics}", "", 2.0, ratio, "")
        if small.sent and large.sent:
            ratio = large.sent / small.sent
            goals.at_most(f"bytes a failure, {size}: times {small.topics}", "", 1.1, ratio, "")


def plot(all_: List[Costs], path: Path) -> None:
    """A picture of the medians over the size of the robot."""
    figure, axes = pyplot.subplots(1, 3, figsize=(13, 4.2))
    for standby in dict.fromkeys(each.standby for each in all_):
        own = [each for each in all_ if each.standby == standby]
        sizes = [each.topics for each in own]
        for step, axis in (("takeover", axes[0]), ("health change", axes[1])):
            middles = [1e3 * summary(each.steps[step])[0] for each in own]
            axis.semilogx(sizes, middles, "o-", label=standby)
        axes[2].loglog(sizes, [each.startup for each in own], "o-", label=standby)
    axes[0].axhline(1.0, color="black", linestyle=":", label="goal")
    for axis in axes[:2]:
        axis.set_ylim(bottom=0.0)
    axes[0].set_ylabel("deciding a failure until it is healed (ms)")
    axes[1].set_ylabel("a change of health (ms)")
    axes[2].set_ylabel("start until all plans are ready (s)")
    for axis in axes:
        axis.set_xlabel("topics, all needed")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(str(path), dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=SIZES[-1], help="most topics (1000)")
    parser.add_argument("--rounds", type=int, default=200, help="failures a robot (200)")
    parser.add_argument(
        "--results", type=Path, default=Path("results/bench"), help="where to write"
    )
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    all_: List[Costs] = []
    bytes_of = sender()
    for standby in (Standby.WARM, Standby.HOT, Standby.COLD):
        for size in SIZES:
            if size <= options.largest:
                measure(size, standby, 2, None)  # what is done once is done now
                all_.append(measure(size, standby, options.rounds, bytes_of))
                print(f"{size} {standby} topics measured", flush=True)
    columns = (
        "topics",
        *(f"{step}, us" for step in STEPS),
        "start, ms (a topic)",
        "lines",
        "bytes sent",
    )
    print_table("Median / p95 (times the smallest robot's)", columns, rows_of(all_))
    goals = Goals()
    check(all_, goals)
    document = [as_dict(each) for each in all_]
    (options.results / "robot_size.json").write_text(json.dumps(document, indent=1) + "\n")
    plot(all_, options.results / "robot_size.png")
    goals.show(options.results / "robot_size_goals.csv")


def as_dict(costs: Costs) -> Dict[str, Any]:
    """Return the document: median, 95th percentile and largest of each step, in s."""
    steps = {step: summary(values) for step, values in costs.steps.items()}
    return {**costs._asdict(), "steps": steps}


if __name__ == "__main__":
    main()

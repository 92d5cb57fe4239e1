"""Limits of healing: 10, 100 and 1,000 topics on 3, 10 and 30 computers.

    python3 scale.py [--short] [--costs FILE] [--results DIR]

Measures what messages, failures and registrations cost on this machine, checks a discrete-event
model against runs that it has not seen, and lets the model go on where the machine ends: with one
monitor for all, and with a monitor on each computer. Writes scale_costs.json, scale_check.csv,
scale.csv and scale.png.
"""
import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Tuple

from matplotlib import pyplot
from tqdm import tqdm

from report import print_table, summary, write_table
import scale_measured as measured
import scale_model as model
from scale_model import Costs, Flow, Load, Robot

TOPICS, HOSTS = (10, 100, 1000), (3, 10, 30)
LINK = 12.5e6
"""Bytes/s: 100 Mbit/s."""
LATENCY_S = 0.0002
FLOWS = {"50 Hz, 76 B": (50.0, 8), "10 Hz, 8 kB": (10.0, 1000)}
BURSTS, SEEN_BURST = (1, 10, 40), 20
STORMS = (60, 200)
TAKEOVERS = 8
TOLERANCE = 0.3
KEPT_UP = 0.9
"""A run counts where so much of what should have been sent was handled."""
QUIET = 0.1
"""Share of time that the monitor may wait for a processor: else times tell of its neighbours."""
FOUND_S = 0.05
USUAL_DESCRIPTORS = 1024
LOOK_S = 2.0
"""Between two looks of the reconfigurator at the master."""
COLUMNS = (
    *("flow", "topics", "hosts", "monitors", "monitor", "link"),
    *("node dies: found", "healed", "host lost: healed", "breaks"),
)


def once(work: Callable[..., Any], *arguments: Any) -> Any:
    """Call it in a process of its own: a ROS node cannot start twice in one."""
    with ProcessPoolExecutor(1) as executor:
        return executor.submit(work, *arguments).result()


def measure(seconds: float, short: bool) -> Tuple[Costs, Dict[str, float]]:
    """Return the costs, and what the model is checked against: what was measured, by its name."""
    deaths = once(measured.deaths, BURSTS)
    first, each = measured.slope(deaths)
    told("deaths of nodes", deaths)
    seen = [told("flow", once(measured.monitor_at, flow, seconds)) for flow in measured.FITTED]
    monitor = measured.fit(seen)
    small, large = (told("start", once(measured.start_of, size)) for size in (30, 300))
    topics = large.topics - small.topics
    master = told("master", once(measured.master_costs, 200 if short else 2000))
    there, back = told("bytes on the link", once(measured.link_bytes, Flow(10, 20.0, 8), 5.0))
    published = sorted(told("takeovers", once(measured.takeovers, TAKEOVERS)).published)
    costs = Costs(
        **monitor,
        failure=each,
        sight=max(0.0, first - monitor["turn"] - each),
        connect=(large.monitor - small.monitor) / topics,
        descriptors=(large.descriptors - small.descriptors) / topics,
        healed=published[0],
        next_healed=(published[-1] - published[0]) / (len(published) - 1),
        call=master["call"],
        look_up=master["look_up"],
        notification=master["notification"],
        told=master["notification_wall"],
        state_row=master["state_row"],
        packet=there - model.message_bytes(8) - model.PREFIX_B,
        back=back,
    )
    return costs, {} if short else real_runs(seconds)


def real_runs(seconds: float) -> Dict[str, float]:
    """Figures of runs from which no cost was taken."""
    found: Dict[str, float] = {}
    for flow in measured.CHECKED:
        seen = told("flow", once(measured.monitor_at, flow, seconds))
        if seen.handled < KEPT_UP * flow.messages:
            continue  # the sources had no processor, or the monitor had none
        found[f"share of the monitor, {words(flow)}"] = seen.share
        if seen.waited <= QUIET:
            found[f"node dies: found (median), {words(flow)}"] = summary(seen.after)[0]
    burst = once(measured.deaths, (SEEN_BURST,))[SEEN_BURST]
    found[f"{SEEN_BURST} topics die: the last is found"] = burst[-1]
    found["bytes on the link, 8 kB"] = once(measured.link_bytes, Flow(10, 20.0, 1000), 5.0)[0]
    for topics in STORMS:
        took, work = told("registrations", once(measured.storm, topics))
        found[f"{topics} topics come at once: until all are heard"] = took
        found[f"{topics} topics come at once: work of the master"] = work
    healed = told("takeovers", once(measured.takeovers, TAKEOVERS // 2)).published
    found[f"{TAKEOVERS // 2} topics are taken over: the last is heard"] = max(healed)
    return found


def modelled(costs: Costs) -> Dict[str, float]:
    """Return the same figures by the model."""
    found: Dict[str, float] = {}
    for flow in measured.CHECKED:
        alone = Robot(flow, 1, LINK, 0.0, measured.OF_VICTIM)
        load = model.load(alone, costs, 4.0)
        found[f"share of the monitor, {words(flow)}"] = load.monitor
        found[f"node dies: found (median), {words(flow)}"] = summary(load.found)[0]
    last = model.burst(costs, SEEN_BURST)[-1]
    found[f"{SEEN_BURST} topics die: the last is found"] = last
    found["bytes on the link, 8 kB"] = model.on_link(costs, model.message_bytes(1000))
    for topics in STORMS:
        took, work = model.introduced(costs, topics, 1, 1)
        found[f"{topics} topics come at once: until all are heard"] = took
        found[f"{topics} topics come at once: work of the master"] = work
    count = TAKEOVERS // 2
    late = costs.healed + (count - 1) * costs.next_healed
    found[f"{count} topics are taken over: the last is heard"] = late
    return found


def words(flow: Flow) -> str:
    """Return a flow in words."""
    size = model.message_bytes(flow.numbers)
    return f"{flow.topics} topics at {flow.rate:g} Hz, {size} B"


def told(what: str, found: Any) -> Any:
    """Say what was found."""
    print(f"{what}: {found}", flush=True)
    return found


def check(real: Dict[str, float], costs: Costs, results: Path) -> None:
    """Show reality and model side by side."""
    by_model = modelled(costs)
    rows = []
    for name, measure_ in real.items():
        off = by_model[name] / measure_ - 1.0
        verdict = "within" if abs(off) <= TOLERANCE else "out of it"
        rows.append(
            (name, f"{measure_:.4g}", f"{by_model[name]:.4g}", f"{100 * off:+.0f} %", verdict)
        )
    columns = ("figure", "measured", "model", "difference", f"tolerance {100 * TOLERANCE:.0f} %")
    print_table("The model beside real runs, s and shares of a core", columns, rows)
    write_table(results / "scale_check.csv", columns, rows)


class Row(NamedTuple):
    """One robot, and its load."""

    flow: str
    robot: Robot
    load: Load

    def p95(self, name: str) -> float:
        """Return a 95th percentile in s; not a number where a host has no topic."""
        return summary(getattr(self.load, name))[1]

    @property
    def each(self) -> int:
        """Topics of a monitor."""
        robot = self.robot
        return -(-robot.flow.topics // (robot.hosts if robot.monitor_per_host else 1))

    def breaks(self, costs: Costs) -> str:
        """Return what has no more to give, or comes too late."""
        found = {
            "monitor": self.load.monitor > 1.0,
            "link": self.load.link > 1.0,
            "detection": self.p95("found") > FOUND_S,
            "descriptors": self.each * costs.descriptors > USUAL_DESCRIPTORS,
        }
        return ", ".join(name for name, broken in found.items() if broken)


def sweep(costs: Costs, sizes: Sequence[int], seconds: float) -> List[Row]:
    """Return every robot by the model."""
    rows: List[Row] = []
    robots = [
        (name, Robot(Flow(size, *flow), hosts, LINK, LATENCY_S, 10, split))
        for name, flow in FLOWS.items()
        for size in sizes
        for hosts in HOSTS
        for split in (False, True)
    ]
    for name, robot in tqdm(robots, "robots", leave=False):
        rows.append(Row(name, robot, model.load(robot, costs, seconds)))
    return rows


def show(rows: Sequence[Row], costs: Costs, results: Path) -> None:
    """The table of all robots."""
    table = []
    for row in rows:
        robot = row.robot
        shares = [f"{100 * share:.2g} %" for share in (row.load.monitor, row.load.link)]
        times = [f"{1e3 * row.p95(name):.0f}" for name in ("found", "healed", "lost_healed")]
        monitors = "each host" if robot.monitor_per_host else "one"
        who = (row.flow, str(robot.flow.topics), str(robot.hosts), monitors)
        table.append((*who, *shares, *times, row.breaks(costs)))
    print_table("By the model; times in ms, p95", COLUMNS, table)
    write_table(results / "scale.csv", COLUMNS, table)
    of_master: List[Tuple[str, ...]] = []
    for topics in TOPICS:
        for count in (1, *HOSTS):
            took, work = model.introduced(costs, topics, count, max(1, topics // 10))
            look = 3 * topics * costs.state_row
            figures = f"{took:.2f}", f"{work:.2f}", f"{100 * look / LOOK_S:.2g} %"
            of_master.append((str(topics), str(count), *figures))
    columns = (
        "topics",
        "monitors",
        "a start: all heard, s",
        "work of the master, s",
        "looks at it",
    )
    print_table("The master, by the model", columns, of_master)
    write_table(results / "scale_master.csv", columns, of_master)


def plot(rows: Sequence[Row], path: Path) -> None:
    """Loads and times over the number of topics."""
    figure, axes = pyplot.subplots(2, 3, figsize=(13, 7.5), sharex=True)
    colours = dict(zip(HOSTS, ("tab:blue", "tab:orange", "tab:green")))
    for line, flow in zip(axes, FLOWS):
        for hosts in HOSTS:
            for split, style in ((False, "o-"), (True, "s--")):
                own = [
                    row
                    for row in rows
                    if (row.flow, row.robot.hosts, row.robot.monitor_per_host)
                    == (flow, hosts, split)
                ]
                sizes = [row.robot.flow.topics for row in own]
                label = f"{hosts} hosts, {'a monitor each' if split else 'one monitor'}"
                values = (
                    [row.load.monitor for row in own],
                    [row.load.link for row in own],
                    [1e3 * row.p95("found") for row in own],
                )
                for axis, each in zip(line, values):
                    axis.loglog(sizes, each, style, color=colours[hosts], label=label, alpha=0.8)
        titles = (
            "busiest monitor, share of a core",
            "busiest link, share",
            "a dead node is found, p95 in ms",
        )
        limits = (1.0, 1.0, 1e3 * FOUND_S)
        for axis, title, limit in zip(line, titles, limits):
            axis.axhline(limit, color="black", linestyle=":")
            axis.set_title(f"{title}: {flow}", fontsize=9)
            axis.grid(alpha=0.3)
    for axis in axes[-1]:
        axis.set_xlabel("topics")
    axes[0][0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(str(path), dpi=110)


def main() -> None:
    """Measure, check, go on by the model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="few topics, and no check")
    parser.add_argument(
        "--costs", type=Path, help="scale_costs.json of a former run: measure nothing"
    )
    parser.add_argument(
        "--results", type=Path, default=Path("results/bench"), help="where to write"
    )
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    if options.costs:
        former = json.loads(options.costs.read_text())
        costs, real = Costs(**former["costs"]), former["real"]
    else:
        costs, real = measure(2.0 if options.short else 8.0, options.short)
        document = {"costs": costs._asdict(), "real": real}
        path = options.results / "scale_costs.json"
        path.write_text(json.dumps(document, indent=1) + "\n")
    told("costs", costs)
    if real:
        check(real, costs, options.results)
    rows = sweep(costs, TOPICS[:1] if options.short else TOPICS, 2.0)
    show(rows, costs, options.results)
    plot(rows, options.results / "scale.png")


if __name__ == "__main__":
    main()

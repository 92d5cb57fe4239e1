"""Witnesses on the simulated rover: false alarms, and what a wrong sensor takes to be found.

Unseen drives run through the monitor's core, as fast as it can. Every value of the SOM is compared
by the known errors (`witness: true`). Then the amperemeter drifts, or stays where it is.
"""
import argparse
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Callable, Counter as Count, Dict, Iterator, List, Optional, Tuple

import numpy as np
from tqdm import tqdm

from healed import drive
from report import Goals, print_table, write_table
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.checks import LEARNED, Witness
from shsa_core.model.health import PublisherHealth
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import Connected, Message, SomChanged, Tick
from shsa_core.monitoring.evidence import checked_provisions
from shsa_core.monitoring.machine import Monitor
from shsa_core.monitoring.overview import Condition
from shsa_rover.dataset import CURRENT, PERIOD_S, Dataset
from shsa_rover.worlds import WORLDS
from shsa_testing.failures import failures_in

MODELS = Path(__file__).resolve().parents[1] / "ontology"
FIRST_SEED = 30000
SLOWEST_ROWS = 5  # messages are fed at 10 Hz: witnesses look five times a second, however many come
WRONG_FROM = 0.5  # of a drive
LOST = "amperemeter"
Fault = Callable[[float, float, float], float]
"""By the time (s) since it began, the true reading and the last good one: what is said instead."""
NOISE = Random(1)
FAULTS: Dict[str, Fault] = {
    "drift of 0.05 A/s": lambda time, value, last: value + 0.05 * time,
    "drift of 0.02 A/s": lambda time, value, last: value + 0.02 * time,
    "stuck, with noise": lambda time, value, last: last + NOISE.gauss(0.0, 0.016),
    "offset of 5 A": lambda time, value, last: value + 5.0,
}
FOUND = ("fault", "runs", "found", "others blamed", "median", "p95", "error at detection, A")
ALARMS = ("world", "service", "hours", "false alarms", "doubtful, % of the time")


@dataclass(frozen=True)
class Watched:
    """Failures that the monitor found in a drive, and looks at which a service was doubtful."""

    failures: Tuple[PublisherHealth, ...]
    doubtful: Count[str]
    looks: int


def compared(som: Som) -> Som:
    """Return the SOM with every value of a periodic service compared by the known errors."""
    return Som([_compared(service) for service in slower(som)])


def slower(som: Som) -> Som:
    """Return the SOM with no more messages than witnesses look at."""
    """Return the SOM with no more messages than witnesses look at."""
    slowest = SLOWEST_ROWS * PERIOD_S
    return Som([replace(s, period=s.period and max(s.period, slowest)) for s in som])


def _compared(service: Service) -> Service:
    if service.event_driven:
        return service
    provides = [
        replace(
            each,
            checks=(*(c for c in each.checks if not isinstance(c, Witness)), Witness(LEARNED)),
        )
        for each in service.provides
    ]
    return replace(service, provides=tuple(provides))


def messages(data: Dataset, som: Som) -> Iterator[Tuple[float, Service, Tuple[float, ...]]]:
    """Yield the values of the services in a drive, as each is due."""
    columns = []
    for service in som:
        paths = [service.source(each.property) for each in checked_provisions(service)]
        rows = np.array([data.measured[each.path] for each in paths if each]).T.tolist()
        columns.append((service, round((service.period or PERIOD_S) / PERIOD_S), rows))
    for number, now in enumerate(data.time.tolist()):
        for service, every, rows in columns:
            if number % every == 0:
                yield now, service, tuple(rows[number])


def watch(data: Dataset, som: Som, ontology: Ontology, stop: bool = False) -> Watched:
    """Run a drive through the monitor's core; `stop`: at the first failure."""
    core, found = Monitor(ontology=ontology), []
    doubtful: Count[str] = Counter()
    start, looks, second = 1000.0, 0, -1
    core.handle(SomChanged(start, som))
    for service in som:
        core.handle(Connected(start, service.topic, service.node))
    for now, service, values in messages(data, som):
        said = core.handle(Message(start + now, service.topic, service.node, values))
        if int(now) != second:
            second, looks = int(now), looks + 1
            said += core.handle(Tick(start + now))
            states = core.overview()
            doubtful.update(e.service.name for e in states if e.condition is Condition.DOUBTFUL)
        found += failures_in(said)
        if found and stop:
            break
    return Watched(tuple(found), doubtful, looks)


def wrong(data: Dataset, fault: Fault) -> Dataset:
    """Return the same drive, with an amperemeter that is wrong from half of it on."""
    begin = int(WRONG_FROM * len(data.time))
    current = data.measured[CURRENT].tolist()
    last = current[begin]
    for row in range(begin, len(current)):
        current[row] = fault((row - begin) * PERIOD_S, current[row], last)
    return replace(data, measured={**data.measured, CURRENT: np.array(current)})


def _only_current(som: Som) -> Som:
    """Only the current is compared."""
    return Som([_compared(each) if each.name == LOST else each for each in slower(som)])


def found_in(
    data: Dataset, som: Som, ontology: Ontology, fault: Fault
) -> Tuple[Optional[float], str, float]:
    """Return the delay of a finding (s; None: never), the accused, and the error then (A)."""
    spoilt = wrong(data, fault)
    failures = watch(spoilt, som, ontology, stop=True).failures
    if not failures:
        return None, "", float("nan")
    took = failures[0].since - 1000.0 - WRONG_FROM * len(data.time) * PERIOD_S
    row = min(len(data.time) - 1, int((failures[0].since - 1000.0) / PERIOD_S))
    error = spoilt.measured[CURRENT][row] - data.measured[CURRENT][row]
    return took, failures[0].service, abs(float(error))


def main() -> int:
    """Watch healthy drives, then wrong ones; print and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=3, help="in each world")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each drive")
    parser.add_argument("--ontology", type=Path, default=MODELS / "rover.yaml")
    parser.add_argument("--som", type=Path, default=MODELS / "rover_som.yaml")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    ontology, som = read_ontology(str(options.ontology)), read_som(str(options.som))
    hours = options.drives * options.minutes / 60.0
    alarms: Count[Tuple[str, str]] = Counter()
    doubts: Count[Tuple[str, str]] = Counter()
    looks: Count[str] = Counter()
    took: Dict[str, List[Tuple[Optional[float], str, float]]] = {name: [] for name in FAULTS}
    turns = [(w, FIRST_SEED + i) for i in range(options.drives) for w in WORLDS]
    for world, seed in tqdm(turns, desc="drives", disable=None):
        data = drive(WORLDS[world], seed, 60.0 * options.minutes)
        seen = watch(data, compared(som), ontology)
        for each in seen.failures:
            alarms[world, each.service] += 1
            print(f"{world}, seed {seed}: {each.since - 1000.0:.1f} s: {each.kind}: {each.detail}")
        doubts.update({(world, name): count for name, count in seen.doubtful.items()})
        looks[world] += seen.looks
        for name, fault in FAULTS.items():
            took[name].append(found_in(data, _only_current(som), ontology, fault))
    rows = [
        [
            world,
            service.name,
            f"{hours:.2g}",
            str(alarms[world, service.name]),
            f"{100.0 * doubts[world, service.name] / looks[world]:.1f}",
        ]
        for world in WORLDS
        for service in som
    ]
    print_table("Healthy drives, every value compared by the known errors", ALARMS, rows)
    found = [_row(name, results) for name, results in took.items()]
    print_table("A wrong current, s until it is found", FOUND, found)
    of_current = sum(count for (_, name), count in alarms.items() if name == LOST)
    goals = Goals()
    goals.at_most("false alarms, every value", "all worlds", 0, sum(alarms.values()), "")
    goals.at_most("false alarms, the current", "all worlds", 0, of_current, "")
    blamed = sum(int(row[3]) for row in found)
    goals.at_most("others blamed for a wrong current", "all worlds", 0, blamed, "")
    write_table(options.results / "witnesses_alarms.csv", ALARMS, rows)
    write_table(options.results / "witnesses_found.csv", FOUND, found)
    goals.show(options.results / "witnesses_goals.csv")
    return 0


def _row(name: str, results: List[Tuple[Optional[float], str, float]]) -> List[str]:
    early = [1 for time, _, _ in results if time is not None and time < 0.0]
    right = [(t, e) for t, who, e in results if t is not None and t >= 0.0 and who == LOST]
    others = sum(1 for _, who, _ in results if who not in ("", LOST)) + len(early)
    times = [time for time, _ in right] or [float("nan")]
    errors = [error for _, error in right] or [float("nan")]
    return [
        name,
        str(len(results)),
        str(len(right)),
        str(others),
        f"{np.median(times):.0f}",
        f"{np.percentile(times, 95):.0f}",
        f"{np.median(errors):.1f}",
    ]


if __name__ == "__main__":
    raise SystemExit(main())

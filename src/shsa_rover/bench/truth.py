"""Errors of a substitute in worlds that nothing was fitted to, and if it knows them itself.

In each unseen drive the amperemeter is lost at a random time; the state of charge is counted on by
what takes over. Then every derivation of every property is compared with the truth, and with the
error that is predicted of it.
"""
import argparse
from dataclasses import astuple, fields
from pathlib import Path
from typing import Dict, List, Mapping, Sequence, Tuple

import numpy as np
from tqdm import tqdm

from agreement import COLUMNS as RANKED
from agreement import Ranked, correlation, covered, ranked
from healed import CALIBRATED, CHOSEN, WAYS, Outcome, by_way, drive, outcomes, plans
from report import Goals, print_table, write_table
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_rover.worlds import WORLDS
from truth_plot import CHARGE_GOAL, NRMSE_GOAL, plot

MODELS = Path(__file__).resolve().parents[1] / "ontology"
FIRST_SEED = 20000  # no relation was learned from a drive of such a seed
P95_GOAL, LAG_GOAL, RANK_GOAL, COVERED_GOAL = 0.3, 0.05, 0.7, (0.93, 0.97)
RANKED_SECONDS = 120.0
STATED_IN = "as_fitted"
"""The world that the stated errors are of; the others show what they are worth."""


def p95(values: Sequence[float]) -> float:
    return float(np.percentile(values, 95))


def nrmse(rows: Sequence[Outcome]) -> float:
    """% of the span, of all drives together."""
    squares = np.mean([each.rms**2 for each in rows])
    return 100.0 * float(np.sqrt(squares) / np.mean([each.span for each in rows]))


def figures(table: Mapping[Tuple[str, str], List[Outcome]]) -> List[List[str]]:
    """Return a row for each world and way."""
    rows = []
    for (world, way), found in table.items():
        charges = [each.charge_error for each in found]
        within = [each.covered for each in found if each.covered is not None]
        rows.append(
            [
                world,
                way,
                f"{np.median(charges):.3f}",
                f"{p95(charges):.3f}",
                f"{min(charges):.3f} to {max(charges):.3f}",
                f"{nrmse(found):.1f}",
                f"{np.median([each.lag for each in found]):.3f}",
                f"{100.0 * np.mean(within):.1f}" if within else "",
            ]
        )
    return rows


HEADER = ("world", "way", "median", "p95", "range", "NRMSE, %", "lag, s", "within p95, %")


def judge_ways(goals: Goals, table: Mapping[Tuple[str, str], List[Outcome]]) -> None:
    """The goals of what takes over: the chosen derivation, calibrated."""
    for (world, way), found in table.items():
        if way == CHOSEN + CALIBRATED:
            charges = [each.charge_error for each in found]
            median, lag = np.median(charges), np.median([each.lag for each in found])
            goals.at_most("state of charge, median", world, CHARGE_GOAL, float(median), "points")
            goals.at_most("state of charge, p95", world, P95_GOAL, p95(charges), "points")
            goals.at_most("current, NRMSE", world, NRMSE_GOAL, nrmse(found), "%")
            goals.at_most("lag", world, LAG_GOAL, abs(float(lag)), "s")
            within = [each.covered for each in found if each.covered is not None]
            if within:
                share = float(np.mean(within))
                goals.within("calibrated p95 covers", world, COVERED_GOAL, share)


def judge_ranked(goals: Goals, found: List[Ranked]) -> List[List[str]]:
    """Return the goals of what is stated; a row for each world and property."""
    rows = []
    groups: Dict[Tuple[str, str], List[Ranked]] = {}
    for each in found:
        groups.setdefault((each.world, each.property), []).append(each)
    for (world, name), group in groups.items():
        rank, share = correlation(group), covered(group)
        count = len({each.number for each in group})
        rows.append([world, name, str(count), f"{rank:.2f}", f"{100.0 * share:.1f}"])
        if world != STATED_IN:
            continue
        if np.isfinite(rank):
            goals.at_least(f"rank correlation, {name}", world, RANK_GOAL, rank)
        if np.isfinite(share):
            goals.within(f"stated p95 covers, {name}", world, COVERED_GOAL, share)
    return rows


def main() -> int:
    """Drive, lose the sensor, compare; print, draw and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=30, help="in each world")
    parser.add_argument("--minutes", type=float, default=10.0, help="of each drive")
    parser.add_argument("--ranked", type=int, default=3, help="of them for every derivation")
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS), choices=list(WORLDS))
    parser.add_argument("--ontology", type=Path, default=MODELS / "rover.yaml")
    parser.add_argument("--som", type=Path, default=MODELS / "rover_som.yaml")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    ontology, som = read_ontology(str(options.ontology)), read_som(str(options.som))
    choices = plans(ontology, som)
    for name, plan in zip(("chosen", "second choice"), choices):
        print(f"{name}: {', '.join(plan.relations)} of {', '.join(plan.program.inputs)}")
    found: List[Outcome] = []
    compared: List[Ranked] = []
    turns = [(world, FIRST_SEED + i) for i in range(options.drives) for world in options.worlds]
    for world, seed in tqdm(turns, desc="drives", disable=None):
        data = drive(WORLDS[world], seed, 60.0 * options.minutes)
        found += outcomes(world, seed, data, ontology, choices)
        if seed - FIRST_SEED < options.ranked:
            compared += ranked(world, data, ontology, som, RANKED_SECONDS)
    found.sort(key=lambda each: (options.worlds.index(each.world), WAYS.index(each.way)))
    table, goals = by_way(found), Goals()
    compared.sort(key=lambda each: (options.worlds.index(each.world), each.property))
    judge_ways(goals, table)
    rows = figures(table)
    print_table("State of charge at the end, percentage points; current", HEADER, rows)
    stated = judge_ranked(goals, compared)
    if stated:
        print_table("What is stated of every derivation", RANKED, stated)
    write_table(options.results / "truth.csv", HEADER, rows)
    names = [field.name for field in fields(Outcome)]
    write_table(options.results / "truth_drives.csv", names, [astuple(each) for each in found])
    names = [field.name for field in fields(Ranked)]
    write_table(options.results / "truth_ranked.csv", names, [astuple(each) for each in compared])
    goals.show(options.results / "truth_goals.csv")
    plot(table, options.worlds, options.results / "truth.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Tries the scoreboard's lines on real processes; goes on where the last run ended.

Exit status 1 if a line does not hold.
"""
import argparse
import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Dict, List, Sequence

from tabulate import tabulate
from tqdm import tqdm

from graph import Graph
from reliability import claims, found, healers, limits, platform, publishers, watched
from reliability.scoreboard import Line, Record, Trial, Verdict, judge

LINES: Dict[int, Line] = {
    line.number: line
    for part in (publishers, found, watched, healers, platform, claims, limits)
    for line in part.LINES
}
COLUMNS = ("#", "fault", "trials", "held", "fails at most", "median / p95 / max", "verdict")


def work(number: int, seeds: Sequence[int], busy: int) -> None:
    """Make the trials of one line in this process; print a JSON line each."""
    with Graph() as graph:
        graph.start_busy(busy)
        for trial in LINES[number].trials(graph, seeds):
            print(json.dumps(asdict(trial)), flush=True)


def run(line: Line, seeds: List[int], busy: int, record: Record) -> None:
    """Make the trials of a line in a process of their own, beside so many busy ones."""
    words = [str(line.number), "--busy", str(busy), "--seeds", *map(str, seeds)]
    command = [sys.executable, "-m", "reliability", "--work", *words]
    progress = tqdm(total=len(seeds), desc=f"{line.number}: {line.fault}"[:40], disable=None)
    with subprocess.Popen(command, stdout=subprocess.PIPE, universal_newlines=True) as process:
        assert process.stdout is not None
        for text in process.stdout:
            trial = Trial(**json.loads(text))
            record.add(trial)
            progress.update()
            if not trial.held:
                tqdm.write(f"{line.number}, seed {trial.seed}: {trial.why}")
    progress.close()
    for seed in record.missing(line.number, seeds):
        why = f"the trials ended with exit status {process.returncode}"
        record.add(Trial(line.number, seed, False, why=why))
        break  # the others were not begun


def show(verdicts: Sequence[Verdict]) -> None:
    """Print the scoreboard as a table."""
    rows = []
    for each in verdicts:
        figures = [
            f"{name} {' / '.join(f'{value:.3g}' for value in values)}"
            for name, values in each.figures.items()
        ]
        verdict = "holds" if each.good else "; ".join(each.missed) or "does not hold"
        bound = f"{100 * each.fails_at_most:.1f} %"
        rows.append(
            (each.line, each.fault, each.trials, each.held, bound, "\n".join(figures), verdict)
        )
    print(tabulate(rows, COLUMNS, tablefmt="grid", disable_numparse=True))


def main() -> int:
    """Try, show, write the verdicts."""
    parser = argparse.ArgumentParser(prog="tools/reliability", description=__doc__)
    parser.add_argument("lines", type=int, nargs="*", help="numbers of lines; none: all")
    parser.add_argument("--short", action="store_true", help="a few trials, without the marks")
    parser.add_argument("--anew", action="store_true", help="forget the trials made so far")
    parser.add_argument("--trials", type=int, help="of each line, instead of its own number")
    parser.add_argument(
        "--seed", type=int, default=0, help="the first trial's; the next ones follow"
    )
    parser.add_argument("--busy", type=int, default=0, help="processes that compute meanwhile")
    parser.add_argument("--results", type=Path)
    parser.add_argument("--work", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--seeds", type=int, nargs="*", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work is not None:
        work(options.work, options.seeds, options.busy)
        return 0
    unknown = sorted(set(options.lines) - set(LINES))
    if unknown:
        parser.error(f"no such line: {unknown}; there are {sorted(LINES)}")
    folder = f"reliability_busy_{options.busy}" if options.busy else "reliability"
    options.results = options.results or Path("results") / folder
    options.results.mkdir(parents=True, exist_ok=True)
    path = options.results / "trials.jsonl"
    if options.anew and path.exists():
        path.unlink()
    record = Record(path)
    chosen = [LINES[number] for number in options.lines or sorted(LINES)]
    if options.short:
        chosen = [line for line in chosen if line.short]  # the others have tests of their own
    for line in chosen:
        count = options.trials or (line.short if options.short else line.full)
        seeds = record.missing(line.number, range(options.seed, options.seed + count))
        if seeds:
            run(line, seeds, options.busy, record)
    verdicts = [judge(line, record.trials, marks=not options.short) for line in chosen]
    show(verdicts)
    document = [{**asdict(each), "holds": each.good} for each in verdicts]
    (options.results / "scoreboard.json").write_text(json.dumps(document, indent=1) + "\n")
    return 0 if all(each.good for each in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())

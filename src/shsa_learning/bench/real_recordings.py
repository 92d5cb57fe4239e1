"""Relations learned from real recordings that others published, beside an honest reference.

    python3 real_recordings.py [--data DIR] [--only NAME ...] [--short] [--results DIR]

Each is learned by `shsa learn`, in a process of its own: an error of a model at most 1.1 times that
of nested blocked cross-validation by scikit-learn from the same inputs, or a refusal. Of those
whose cut is not in the repository DIR must hold the files; `real_sources.yaml` says where they are.
"""
import argparse
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import List

import numpy as np
from real_reference import reference
from real_sources import CUTS, Source, cut, sources, write
from report import Goals, write_table

RATIO_GOAL = 1.1
LEARN = "import sys; from shsa_core.cli.main import main; sys.exit(main())"
COLUMNS = (
    "recording",
    "origin",
    "file",
    "target",
    "outcome",
    "NRMSE, %",
    "worst block, %",
    "terms",
    "reference, %",
    "by",
    "mean, %",
    "ratio",
    "seconds",
    "reason",
)


def measured(source: Source, path: Path) -> List[object]:
    """Return a row: what `shsa learn` says of a recording, and what the reference does."""
    asked = ["--data", str(path), "--from", ",".join(source.inputs), "--json"]
    command = [sys.executable, "-c", LEARN, "learn", source.target, *asked]
    began = perf_counter()
    run = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8")
    took = perf_counter() - began
    columns = cut(path)
    inputs = np.array([columns[name] for name in source.inputs]).T
    target = columns[source.target]
    known = np.isfinite(target) & np.isfinite(inputs).all(axis=1)
    best, mean, by = reference(columns["time"][known], target[known], inputs[known])
    percent = 100.0 / float(np.ptp(target[known]))
    told = [source.name, source.origin, source.file, source.target]
    if run.returncode not in (0, 1):
        return [*told, f"failed ({run.returncode})", *[""] * 7, f"{took:.1f}", run.stderr[-200:]]
    answer = json.loads(run.stdout)
    rms, worst = answer["nrmse"], answer["worst_block_nrmse"]
    return [
        *told,
        "learned" if answer["accepted"] else "refused",
        f"{100.0 * rms:.2f}" if rms is not None else "",
        f"{100.0 * worst:.2f}" if worst is not None else "",
        f"{answer['model']} {len(answer['terms']) or ''}" if answer["model"] else "",
        f"{percent * best:.2f}",
        by,
        f"{percent * mean:.2f}",
        f"{100.0 * rms / (percent * best):.2f}" if rms is not None else "",
        f"{took:.1f}",
        answer["reason"],
    ]


def main() -> int:
    """Learn from each recording that is there; print a table, write it and the goals."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="a folder with the files of the others")
    parser.add_argument("--only", nargs="+", default=[""], help="those whose name contains one")
    parser.add_argument("--short", action="store_true", help="one recording, as a check")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    rows: List[List[object]] = []
    with TemporaryDirectory() as folder:
        for source in sources()[:1] if options.short else sources():
            if not any(part in source.name for part in options.only):
                continue
            path = CUTS / source.cut
            if not source.cut:
                if not options.data or not (options.data / Path(source.file).name).exists():
                    continue
                path = Path(folder) / "recording.csv"
                write(path, source.columns(options.data))
            rows.append(measured(source, path))
            print(*rows[-1], sep=" | ", flush=True)
            write_table(options.results / "real_recordings.csv", COLUMNS, rows)
    goals = Goals()
    failed = [row for row in rows if str(row[4]).startswith("failed")]
    goals.at_most("internal failures", f"{len(rows)} recordings", 0, len(failed), "")
    ratios = [float(str(row[11])) for row in rows if row[4] == "learned"]
    if ratios:
        goals.at_most("error / reference", f"{len(ratios)} learned", RATIO_GOAL, max(ratios), "")
    goals.show(options.results / "real_recordings_goals.csv")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Lines 10, 13, 14 and 15: links, hostile input, what lacks, and budgets that cannot be met.

Each has a program or a test of its own; a trial runs it.
"""
import json
import subprocess
import sys
from pathlib import Path
from typing import Iterator, Sequence

from graph import BENCH, PACKAGE, Graph
from reliability.rig import write_model
from reliability.scoreboard import Figures, Line, Trial
from reliability.trying import attempt

ROOT = PACKAGE.parent.parent
DOWN_S = (2.0, 8.0, 20.0)
TIMEOUT_S = 600.0
FUZZ_MIN, SHORT_FUZZ_MIN = 1.0, 0.1


def run(*command: str) -> "subprocess.CompletedProcess[str]":
    """Run a program to its end."""
    return subprocess.run(
        command,
        cwd=str(ROOT),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT_S,
    )


def tested(*arguments: str) -> None:
    """Run tests of the project. Raises AssertionError if one fails."""
    done = run(sys.executable, "-m", "pytest", "-q", "-o", "addopts=", *arguments)
    assert done.returncode == 0, done.stdout[-3000:]


def link_down(seed: int) -> Figures:
    """Take the link to another computer down for a while."""
    seconds = DOWN_S[seed % len(DOWN_S)]
    done = run(sys.executable, str(BENCH / "partition.py"), "--seconds", str(seconds))
    assert done.returncode == 0, done.stdout[-3000:]
    found = json.loads(next(x for x in reversed(done.stdout.splitlines()) if x.startswith("{")))
    assert found["taken_for_good"] == 0 and not found["killed"], str(found)
    assert found["state"] == "ended", str(found)
    return {"gap": found["gap"], "overlap": found["overlap"], "backlog": found["backlog"]}


def links(_: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    for seed in seeds:
        yield attempt(10, seed, lambda: link_down(seed))


def hostile(minutes: float) -> Figures:
    """Hostile inputs of every reader, by seeds that nobody chose."""
    done = run(sys.executable, "test/fuzz.py", str(minutes))
    assert done.returncode == 0, done.stdout[-3000:]
    return {"minutes": minutes}


def inputs(_: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    minutes = FUZZ_MIN if len(seeds) > 1 else SHORT_FUZZ_MIN
    for seed in seeds:
        yield attempt(13, seed, lambda: hostile(minutes))


def lacking() -> Figures:
    """Processes, descriptors and room for a log are lacking, one after the other."""
    tested("test/master_cases.py", "-k", "test_4 or test_5 or test_6")
    return {}


def resources(_: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    for seed in seeds:
        yield attempt(14, seed, lacking)


def budget(folder: Path, seed: int) -> Figures:
    """Check a tolerated time: told if it cannot be met, with the sum; not told if it can."""
    ontology, som = write_model(folder)
    document = json.loads(som.read_text())
    tolerated = (0.001, 60.0)[seed % 2]
    document["services"]["a"]["fault_tolerant_time"] = tolerated
    som.write_text(json.dumps(document))
    done = run("rosrun", "shsa_core", "shsa", "check", str(ontology), "--som", str(som))
    sums = [line for line in done.stdout.splitlines() if "tolerates" in line]
    assert bool(sums) is (tolerated < 1.0) and all(" + " in line for line in sums), done.stdout
    return {}


def budgets(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    for seed in seeds:
        yield attempt(15, seed, lambda: budget(graph.folder, seed))


LINES = (
    Line(
        10,
        "partition of 2, 8, 20 s",
        "no stale message taken for a good one; both sides end with one publisher",
        links,
        full=30,
        short=0,
        so_far="two network namespaces of one computer; healing runs on one side alone.",
    ),
    Line(
        13,
        "hostile ontology, SOM, code string, serial bytes",
        "nothing executed, no hang, a clear error; fuzzed",
        inputs,
        full=20,
        short=0,
    ),
    Line(
        14,
        "disk full, out of processes, out of memory for a spawn",
        "stated, retried with back-off, everything else goes on",
        resources,
        full=10,
        short=0,
        so_far="by the kernel's limits of a process: a whole computer was not filled up.",
    ),
    Line(
        15,
        "a budget that cannot be met (detection plus reaction over the topic's tolerated time)",
        "refused or warned at start, with the sum shown",
        budgets,
        full=20,
        short=2,
    ),
)

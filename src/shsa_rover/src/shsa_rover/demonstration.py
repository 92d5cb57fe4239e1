"""The demonstration of Section V-B1: runs it, draws it, sums it up."""
import argparse
import math
import os
import signal
import socket
import subprocess
import sys
from bisect import bisect_left
from pathlib import Path
from typing import Callable, List, Mapping, Optional, Sequence, Tuple

from tabulate import tabulate

from shsa_rover.figure import draw
from shsa_rover.recording import Recording, Series, last_error, read_recording, unhealed

TIMEOUT_S = 180.0  # the run itself takes about 45 s
DRIVE_END_S = 35.0  # the drive's end


def main(arguments: Optional[List[str]] = None) -> int:
    """Run the demonstration; 0 if the topic was healed and the original returned."""
    parser = argparse.ArgumentParser(description="Run the demonstration of the paper, headless.")
    parser.add_argument("--results", type=Path, default=Path("results/demo"), help="folder")
    return demonstrate(parser.parse_args(arguments).results.resolve(), _launch)


def demonstrate(results: Path, launch: Callable[[Sequence[str]], int]) -> int:
    """Run the demonstration, draw it and sum it up in the folder `results`.

    `launch` runs roslaunch with these arguments, and returns its exit status. 0 if the topic was
    healed and the original returned.
    """
    results.mkdir(parents=True, exist_ok=True)
    for stale in ("run.bag", "run.bag.active", "incidents.jsonl", "figure.png"):
        if (results / stale).exists():
            (results / stale).unlink()
    words = ("shsa_rover", "demo.launch", f"results:={results}", f"end_at:={DRIVE_END_S}")
    status = launch(words)
    if status != 0:
        print(f"roslaunch ended with exit status {status}", file=sys.stderr)
        return 1
    recording = read_recording(results / "run.bag", results / "incidents.jsonl")
    # The drive begins after the first message. What ends later is ended by roslaunch, and is no
    # failure.
    recording.incidents[:] = [
        i for i in recording.incidents if float(str(i["detected"])) < DRIVE_END_S
    ]
    draw(recording, results / "figure.png")
    return _report(recording, results)


def _launch(words: Sequence[str]) -> int:
    """Run roslaunch with a master of its own, so that nothing that runs already is disturbed."""
    with socket.socket() as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    environment = dict(os.environ, ROS_MASTER_URI=f"http://localhost:{port}")
    return await_end(["roslaunch", "-p", str(port), *words], environment)


def await_end(command: Sequence[str], environment: Mapping[str, str]) -> int:
    """Run a command that launches; its exit status. One that does not end is interrupted."""
    with subprocess.Popen(command, env=environment) as roslaunch:
        try:
            return roslaunch.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            roslaunch.send_signal(signal.SIGINT)
            return roslaunch.wait()


def _report(recording: Recording, results: Path) -> int:
    table: List[Tuple[str, str]] = []
    healed = [i for i in recording.incidents if i["first_message"] is not None]
    for incident in recording.incidents:
        outage = incident["outage"]
        healed_in = "not healed" if outage is None else f"{1000 * float(str(outage)):.0f} ms"
        back = "original is back" if incident["state"] == "ended" else "still open"
        table += [
            ("failed", f"{incident['topic']}, {incident['kind']} ({incident['faulty_node']})"),
            ("substitute", f"{incident['substitute']} of quality {incident['quality']:.2f}"),
            ("relations", ", ".join(map(str, incident["relations"]))),  # type: ignore
            ("outage", healed_in),
            ("ended", back),
        ]
    for node, series in recording.current.items():
        if node.startswith("/substitute"):
            text = f"{rms_error(series, recording.true_current):.2f} A (RMS) against the truth"
            table.append(("substitute's error", text))
    if recording.soc and recording.true_soc:
        worst = 100 * max_error(recording.soc, recording.true_soc)
        table.append(("state of charge", f"at most {worst:.2f} percentage points off the truth"))
        failed = [str(incident["faulty_node"]) for incident in healed[:1]]
        alone = 100 * last_error(unhealed(recording, "".join(failed)), recording.true_soc)
        table.append(("without healing", f"{alone:+.2f} percentage points at the end"))
    table.append(("figure", str(results / "figure.png")))
    print(f"The demonstration\n{tabulate(table, disable_numparse=True)}")
    good = len(healed) == 1 and all(i["state"] == "ended" for i in recording.incidents)
    if not good:
        print("The demonstration did not go as planned.", file=sys.stderr)
    return 0 if good else 1


def rms_error(series: Series, truth: Series) -> float:
    """Return the root mean square of a series against the truth at the same times."""
    squares = [(value - _at(truth, time)) ** 2 for time, value in series]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan


def max_error(series: Series, truth: Series) -> float:
    """Return the largest distance of a series from the truth at the same times."""
    return max((abs(value - _at(truth, time)) for time, value in series), default=math.nan)


def _at(series: Series, time: float) -> float:
    index = bisect_left(series, (time, -math.inf))
    return series[min(index, len(series) - 1)][1] if series else math.nan

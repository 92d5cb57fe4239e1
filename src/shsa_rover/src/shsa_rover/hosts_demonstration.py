"""The demonstration on three computers, which are made of this machine's namespaces."""
import argparse
import os
import subprocess
import sys
from pathlib import Path
from typing import List, Optional, Tuple

from shsa_rover.demonstration import await_end, demonstrate
from shsa_testing.computers import Computers, refusal

COMPUTERS = ("raspberry_pi", "mainboard", "notebook")
MASTER = "notebook"
CANNOT = 2


def main(arguments: Optional[List[str]] = None) -> int:
    """Run the demonstration; 0 if it went as planned, 2 where no computers can be made."""
    parser = argparse.ArgumentParser(description="Run the demonstration on three computers.")
    parser.add_argument("--results", type=Path, default=Path("results/hosts_demo"), help="folder")
    results = parser.parse_args(arguments).results.resolve()
    reason = refusal(ssh=True)
    if reason:
        print(f"hosts_demo: {reason}", file=sys.stderr)
        return CANNOT
    with Computers(*COMPUTERS, ssh=True) as network:
        prepare(network)
        more = ("rover:=rover_distributed.launch", "restarted_on:=raspberry_pi")
        launch = lambda words: await_end(launching(network, *words, *more), os.environ)
        return demonstrate(results, launch)


def prepare(network: Computers) -> None:
    """Prepare them as a person would, by hosts_setup on the notebook. Raises CalledProcessError."""
    others = [name for name in COMPUTERS if name != MASTER]
    command = ["rosrun", "shsa_core", "hosts_setup", "--accept", *others]
    subprocess.run(network[MASTER].words(*command, **network.asks), check=True)


def launching(network: Computers, *words: str) -> Tuple[str, ...]:
    """Return the command that runs roslaunch on the notebook, as a person would start it there."""
    environment = network[MASTER].home / ".ros" / "shsa_env"
    # No other master is there, whichever we have here.
    cleared = ("env", "-u", "ROS_MASTER_URI")
    return network[MASTER].words(*cleared, str(environment), "roslaunch", *words)

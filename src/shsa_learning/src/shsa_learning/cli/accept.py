"""`shsa accept`: how right the advice was; then healing may act."""
import argparse
import importlib
from typing import Any

from shsa_core.cli._common import say
from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.som_file import read_som
from shsa_learning.acceptance import advice, with_act
from shsa_learning.cli._namespace import add_namespace
from shsa_learning.incident_log import Log, read_log
from shsa_learning.whole_file import write_whole


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "accept",
        help="say how right healing would have been, and let it act",
        description="Reads the incidents on which healing advised, and says for each service how "
        "often acting would have been right, and what to change. Then it asks, and writes "
        "`act: true` into the SOM: nothing else is ever written. Exit status 1 if it is not.",
    )
    parser.add_argument("--som", metavar="FILE", required=True, help="the SOM that was advised on")
    parser.add_argument("--log", metavar="FILE", default="", help="the incident log")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    add_namespace(parser)


def run(args: argparse.Namespace) -> int:
    """Tell, ask and write. Returns 0 if the SOM says that healing acts, else 1."""
    som = read_som(args.som, args.namespace)
    log = _read(args.log)
    for note in log.notes:
        say(f"Note: {note}", error=True)
    for each in advice(som, log.incidents):
        say(each)
    if som.act:
        say(f"{args.som} says `act: true` already")
        return 0
    changed = with_act(args.som)
    if not args.yes and not _agreed(f"Write `act: true` into {args.som}? [y/N] "):
        return 1
    write_whole(args.som, changed)
    say(f"{args.som} says `act: true` now: start healing anew")
    return 0


def _read(path: str) -> Log:
    try:
        return read_log(path or importlib.import_module("shsa_core.ros.incidents").log_path(""))
    except ImportError as error:
        raise ShsaError(f"name the incident log with --log: there is no ROS here ({error})")
    except ModelError as error:
        if path or not isinstance(error.__cause__, FileNotFoundError):
            raise
        return Log((), (f"{error}: nothing was advised yet",))


def _agreed(question: str) -> bool:
    try:
        return input(question).strip().lower() in ("y", "yes")
    except EOFError:
        return False

"""Options of both commands, and an end that takes faults back."""
import argparse
import signal
import sys
from typing import Any, Optional, Tuple

from shsa_core.files.som_file import read_som
from shsa_core.model.som import Som
from shsa_injection import durations


def add_som(parser: argparse.ArgumentParser) -> None:
    """Add --som and --namespace."""
    parser.add_argument(
        "--som", metavar="FILE", help="the SOM (that of the healing which runs on this computer)"
    )
    parser.add_argument(
        "--namespace", metavar="NAME", help="where relative names of topics and nodes are (/)"
    )


def read_robot(args: argparse.Namespace) -> Tuple[Som, str]:
    """Return the SOM and the namespace that the options name, or those of the running healing."""
    if args.som is not None:
        namespace = args.namespace or "/"
        return read_som(args.som, namespace), namespace
    from shsa_injection.ros import healers

    path, namespace = healers.som_file()
    namespace = args.namespace or namespace
    return read_som(path, namespace), namespace


def duration(text: str) -> float:
    """Return a duration for argparse."""
    try:
        return durations.seconds(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def end_in_order() -> None:
    """From now on a request to end is like Ctrl-C: faults are taken back."""

    def end(number: int, frame: Optional[Any]) -> None:
        sys.exit(128 + number)

    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)

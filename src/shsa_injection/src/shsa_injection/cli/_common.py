"""Options of both commands, and an end that takes faults back."""
import argparse
import math
import re
import signal
import sys
from typing import Any, Optional, Tuple

from shsa_core.cli._common import ros_namespace
from shsa_core.files.som_file import read_som
from shsa_core.model.som import Som

UNITS_S = {"ms": 0.001, "s": 1.0, "": 1.0, "min": 60.0, "h": 3600.0}
_TEXT = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)(ms|s|min|h|)")


def add_som(parser: argparse.ArgumentParser) -> None:
    """Add --som and --namespace."""
    parser.add_argument(
        "--som", metavar="FILE", help="the SOM (that of the healing which runs on this computer)"
    )
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        type=ros_namespace,
        help="where relative names of topics and nodes are (/)",
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
    """Return a duration in s, as a type of argparse: `5s`, `200ms`; a bare number is in s."""
    match = _TEXT.fullmatch(text.strip())
    value = float(match.group(1)) * UNITS_S[match.group(2)] if match else math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no duration above 0, as 5s, 200ms, 1.5min")
    return value


def end_in_order() -> None:
    """Treat a request to end like Ctrl-C from now on: faults are taken back."""

    def end(number: int, frame: Optional[Any]) -> None:
        sys.exit(128 + number)

    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)

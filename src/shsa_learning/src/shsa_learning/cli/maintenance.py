"""`shsa maintenance`: healing kills and starts nothing while people work on the robot."""
import argparse
from typing import Any

from shsa_core.cli._common import say
from shsa_core.errors import ShsaError
from shsa_learning.cli._namespace import add_namespace


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "maintenance",
        help="have healing kill and start nothing for a while",
        description="While it is on, healing kills and starts nothing, and what publishes goes on. "
        "Once it is off, what has failed is healed. Run it as the reconfigurator's user, on its "
        "computer and with its ROS_MASTER_URI. Exit status 1 if the reconfigurator does not say "
        "that it is so.",
    )
    parser.add_argument("state", choices=("on", "off"), nargs="?", help="none: tell which it is")
    add_namespace(parser)


def run(args: argparse.Namespace) -> int:
    """Switch it, and tell what the reconfigurator says. Returns 1 if that is something else."""
    from shsa_core.ros.succession import maintain, maintained
    from shsa_learning.ros.maintenance import check_master, heeded

    check_master()  # where there can be none, the mode counts for nobody
    if args.state:
        maintain(args.namespace, args.state == "on")
    on = maintained(args.namespace)
    word = "on" if on else "off"
    try:
        told = heeded(args.namespace, on)
    except ShsaError as nobody:
        say(f"shsa: {nobody}; maintenance is {word} once one starts", error=True)
        return 1 if on or args.state == "on" else 0
    if told != on:
        text = f"maintenance is {'on' if told else 'off'} as the reconfigurator says it"
        say(f"{text}: run this as its user, on its computer")
        return 1
    say(f"maintenance is {word}")
    return 0 if args.state in (None, word) else 1

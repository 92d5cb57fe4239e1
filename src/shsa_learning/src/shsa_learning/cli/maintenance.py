"""`shsa maintenance`: healing kills and starts nothing while people work on the robot."""
import argparse
from typing import Any

from shsa_core.cli._common import say
from shsa_learning.cli._namespace import add_namespace


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "maintenance",
        help="have healing kill and start nothing for a while",
        description="While it is on, healing kills and starts nothing, and what publishes goes on. "
        "Once it is off, what has failed is healed. Run it as the reconfigurator's user, on its "
        "computer and with its ROS_MASTER_URI.",
    )
    parser.add_argument("state", choices=("on", "off"), nargs="?", help="none: tell which it is")
    add_namespace(parser)


def run(args: argparse.Namespace) -> int:
    """Switch it, and tell. Returns 0."""
    from shsa_core.ros.succession import maintain, maintained

    if args.state:
        maintain(args.namespace, args.state == "on")
    say(f"maintenance is {'on' if maintained(args.namespace) else 'off'}")
    return 0

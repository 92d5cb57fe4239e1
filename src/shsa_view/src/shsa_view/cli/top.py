"""`shsa top`: the robot at a glance, in a terminal."""
import argparse
import json
import os
import sys
from typing import Any

from shsa_core.cli._common import ros_namespace, say
from shsa_core.errors import ShsaError
from shsa_view.glance import Look, lines

PLAIN_WIDTH = 160
"""Characters of a line where it is no terminal."""


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "top",
        help="show a running robot at a glance, in the terminal",
        description="Shows how a running robot is: in words, a row a service with its state, rate, "
        "last value, expected error and publisher, and the open incidents. In a terminal it goes "
        "on until q or Ctrl-C; keys: arrows, s for another order. Elsewhere it prints once.",
    )
    parser.add_argument("--ontology", metavar="FILE", default="", help="for the units of values")
    parser.add_argument(
        "--som", metavar="FILE", default="", help="instead of what lies on the parameter server"
    )
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        type=ros_namespace,
        default="",
        help="where healing runs (ROS_NAMESPACE, or /)",
    )
    parser.add_argument("--secret", metavar="FILE", default="", help="the secret of healing")
    parser.add_argument("--once", action="store_true", help="print once, and end")
    parser.add_argument("--json", action="store_true", help="print the state as one JSON document")


def run(args: argparse.Namespace) -> int:
    """Show the robot. Returns 0, or 1 if nothing of healing was heard."""
    if args.namespace:
        os.environ["ROS_NAMESPACE"] = args.namespace  # as rospy takes it
    from shsa_view.ros import watching  # ROS loads slowly

    if sys.stdout.isatty() and sys.stdin.isatty() and not (args.once or args.json):
        from shsa_view.terminal import show

        return show(watching.Watch(args.ontology, args.som, args.secret))
    if not watching.master_answers():
        raise ShsaError(f"no ROS master answers at {watching.master_uri()}")
    document = watching.once(args.ontology, args.som, args.secret)
    if args.json:
        print(json.dumps(document, indent=2))
    else:
        say("\n".join(lines(document, Look(PLAIN_WIDTH))))
    return 0 if document["healing"]["reconfigurator"] == "alive" else 1

"""`shsa doctor`: what is wrong around a running robot, and what to do about it."""
import argparse
import json
import os
from typing import Any, List

from shsa_core.cli._common import ros_namespace, say
from shsa_core.errors import ShsaError
from shsa_learning.doctor import Finding, fates, findings


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "doctor",
        help="say what is wrong around a running robot, and what to do",
        description="Looks at the secret, the names of the master, the users of the nodes, clocks, "
        "other healers, message types, who publishes and who subscribes, and the incidents of the "
        "last hour. Then says what becomes of each node that fails, and why: whom healing kills, "
        "and whom it keeps. Changes nothing. Exit status 1 if there is a finding.",
    )
    parser.add_argument("--som", metavar="FILE", default="", help="instead of the running one")
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        type=ros_namespace,
        default="",
        help="where healing runs (ROS_NAMESPACE, or /)",
    )
    parser.add_argument("--secret", metavar="FILE", default="", help="the secret of healing")
    parser.add_argument("--log", metavar="FILE", default="", help="the incident log")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(args: argparse.Namespace) -> int:
    """Print the findings. Returns 0 if there is none, else 1."""
    if args.namespace:
        os.environ["ROS_NAMESPACE"] = args.namespace  # as rospy takes it
    try:
        from shsa_learning.ros.examination import examine  # ROS loads slowly
    except ImportError as error:
        raise ShsaError(f"doctor needs ROS: source its setup.bash ({error})") from error
    told: List[str] = []
    when = "now"
    try:
        seen = examine(args.som, args.secret, args.log)
        found, told = findings(seen), fates(seen)
        when = when if seen.som.act else "once healing acts"
    except ShsaError as nothing:
        found = [Finding(str(nothing), "mend that first")]
    if args.json:
        print(json.dumps({"findings": [each._asdict() for each in found], "fates": told}, indent=2))
    else:
        for each in found:
            say(f"{each.what}\n    {each.remedy}")
        count = "1 finding" if len(found) == 1 else f"{len(found)} findings"
        say(count if found else "nothing is wrong here")
        if told:
            say("\n    ".join([f"what becomes of a node, {when}:", *told]))
    return 1 if found else 0

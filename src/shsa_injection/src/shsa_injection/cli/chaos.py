"""`shsa chaos`: makes faults by a seeded schedule, and checks what healing promises after each."""
import argparse
import json
import random
import time
from typing import Any, Dict, Optional, TextIO

from shsa_core.errors import ShsaError
from shsa_injection.cli._common import add_som, end_in_order, read_robot
from shsa_injection.cli.inject import LARGEST_SEED
from shsa_injection.vocabulary import FAULTS


def add_parser(subparsers: Any) -> None:
    """Adds the command."""
    parser = subparsers.add_parser(
        "chaos",
        help="make faults by a seeded schedule, and check what holds",
        description="Makes faults of the topics that the SOM names on a running system, one step "
        "after the other, and checks after each: one publisher a topic, every needed topic served "
        "or reported, every incident ended, nobody innocent killed, no orphan, healers "
        "bounded. The same seed makes the same schedule. Exit status 1 if something did not hold.",
    )
    parser.add_argument("--minutes", metavar="N", type=float, help="no step begins after that")
    parser.add_argument("--steps", metavar="N", type=int, help="end after so many steps")
    parser.add_argument(
        "--seed", metavar="N", type=int, help="for the same schedule again (random)"
    )
    parser.add_argument("--trace", metavar="FILE", help="write every event, a JSON line each")
    parser.add_argument(
        "--only",
        metavar="FAULT",
        action="append",
        default=[],
        help="this fault; several times",
        choices=list(FAULTS),
    )
    parser.add_argument("--healers", action="store_true", help="monitor and reconfigurator as well")
    parser.add_argument("--master", action="store_true", help="restart the master as well")
    parser.add_argument("--keep-going", action="store_true", help="go on after a step that failed")
    add_som(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document at the end")


def run(args: argparse.Namespace) -> int:
    """Makes the faults. Returns 0 if everything held, else 1."""
    if args.minutes is None and args.steps is None:
        raise ShsaError("say how long: --minutes N or --steps N")
    end_in_order()
    som, namespace = read_robot(args)
    seed = random.randrange(LARGEST_SEED) if args.seed is None else args.seed
    if args.trace is None:
        return _run(args, som, namespace, seed, None)
    with open(args.trace, "w", encoding="utf-8") as file:
        return _run(args, som, namespace, seed, file)


def _run(args: Any, som: Any, namespace: str, seed: int, file: Optional[TextIO]) -> int:
    import rospy

    from shsa_core.ros.master.node_api import FAILURES, master_api, master_uri
    from shsa_injection.ros.chaos import Chaos, Extent
    from shsa_injection.trace import Trace

    try:
        master_api("/shsa_chaos").getPid()
    except FAILURES as error:
        raise ShsaError(f"no ROS master answers at {master_uri()}: {error}") from error
    rospy.init_node("shsa_chaos", anonymous=True, disable_signals=True)
    extent = Extent(
        None if args.minutes is None else args.minutes * 60.0,
        args.steps,
        args.healers,
        args.master,
        tuple(args.only),
        args.keep_going,
    )
    trace = Trace(file, time.monotonic, _nothing if args.json else _show)
    chaos = Chaos(som, namespace, seed, extent, trace)
    held = chaos.run()
    again = ["shsa", "chaos", "--seed", str(seed), "--steps", str(chaos.steps)]
    again += [f"--{name}" for name in ("healers", "master") if getattr(args, name)]
    again += [word for fault in args.only for word in ("--only", fault)]
    if args.json:
        found = [vars(each) for each in chaos.violations]
        print(json.dumps({"seed": seed, "steps": chaos.steps, "held": held, "violations": found}))
    elif held:
        print(f"{chaos.steps} steps, everything held; seed {seed}")
    else:
        print(f"{len(chaos.violations)} violations; the same again: {' '.join(again)}")
    return 0 if held else 1


def _nothing(event: Dict[str, Any]) -> None:
    """Show nothing."""


def _show(event: Dict[str, Any]) -> None:
    details = {
        key: value for key, value in event.items() if key not in ("time", "event", "possible")
    }
    text = ", ".join(f"{key} {value}" for key, value in details.items() if value not in ("", {}))
    print(f"{event['time']:9.2f} s  {event['event']:14} {text}", flush=True)

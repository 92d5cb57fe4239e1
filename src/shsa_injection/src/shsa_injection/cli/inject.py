"""`shsa inject`: makes a topic of a running system fail, and takes that back."""
import argparse
import json
import random
import sys
from typing import Any, Dict

from shsa_core.errors import ShsaError
from shsa_core.model.names import full_name
from shsa_injection.cli._common import add_som, duration, end_in_order, read_robot
from shsa_injection.errors import Refused
from shsa_injection.vocabulary import FAULTS, Place

LARGEST_SEED = 2**31 - 1


def add_parser(subparsers: Any) -> None:
    """Adds the command."""
    shown = {word: each.tells for word, each in FAULTS.items() if each.place is not Place.MASTER}
    words = "\n".join(f"  {word:16}{tells}" for word, tells in shown.items())
    parser = subparsers.add_parser(
        "inject",
        help="make a topic of a running system fail",
        description="Makes a topic that the SOM names fail, until --for is over or until Ctrl-C,\n"
        "and takes that back. Exit status 1 if it is refused.",
        epilog=f"faults:\n{words}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("topic", metavar="TOPIC", nargs="?", help="a topic that the SOM names")
    parser.add_argument("fault", metavar="FAULT", nargs="?", choices=shown, help="see below")
    parser.add_argument(
        "--for",
        dest="seconds",
        metavar="TIME",
        type=duration,
        help="5s, 200ms, 1min; off and "
        "crash: the node is started again after it (it stays dead)",
    )
    parser.add_argument("--seed", metavar="N", type=int, help="for the same fault again (random)")
    parser.add_argument("--node", metavar="NAME", default="", help="where several share the topic")
    parser.add_argument(
        "--master",
        action="store_true",
        help="instead of a topic: kill the master, and start it again",
    )
    add_som(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document at the end")


def run(args: argparse.Namespace) -> int:
    """Makes the fault and takes it back. Returns 1 if it is refused."""
    from shsa_injection.ros.injector import Injector

    end_in_order()
    seed = random.randrange(LARGEST_SEED) if args.seed is None else args.seed
    try:
        if args.master:
            if args.topic or args.fault:
                raise ShsaError("--master is for the master alone, without a topic")
            injection = Injector.restart_master(args.seconds or 1.0)
        elif not args.topic or not args.fault:
            raise ShsaError("name a topic and a fault; `shsa inject --help` lists the faults")
        else:
            som, namespace = read_robot(args)
            topic, node = full_name(args.topic, namespace), args.node
            node = full_name(node, namespace) if node else ""
            injection = Injector(som).inject(topic, args.fault, args.seconds, seed, node)
        return _run(injection, args.json)
    except Refused as why:
        print(f"shsa: refused: {why}", file=sys.stderr)
        return 1


def _run(injection: Any, as_json: bool) -> int:
    interrupted = False
    with injection:
        if not as_json:
            print(_beginning(injection), flush=True)
        if not (injection.fault in ("off", "crash") and injection.seconds is None):
            try:
                injection.wait()
            except KeyboardInterrupt:
                interrupted = True
    if as_json:
        print(json.dumps(_as_dict(injection, interrupted)))
    else:
        print(_ending(injection))
    return 0


def _beginning(injection: Any) -> str:
    about = f"{injection.topic} ({injection.node})" if injection.topic else injection.node
    lasts = f" for {injection.seconds:g} s" if injection.seconds is not None else ""
    detail = f": {injection.detail}" if injection.detail else ""
    seed = f", seed {injection.seed}" if FAULTS[injection.fault].place is not Place.PROCESS else ""
    return f"{injection.fault} of {about}, process {injection.pid}{seed}{lasts}{detail}"


def _ending(injection: Any) -> str:
    lasted = injection.ended - injection.began
    if injection.fault in ("off", "crash") and injection.seconds is None:
        return f"{injection.node} has ended; nothing starts it again"
    told = ", ".join(f"{key} {value}" for key, value in injection.told.items())
    return f"taken back after {lasted:.2f} s" + (f" ({told})" if told else "")


def _as_dict(injection: Any, interrupted: bool) -> Dict[str, Any]:
    return {
        "topic": injection.topic,
        "node": injection.node,
        "pid": injection.pid,
        "fault": injection.fault,
        "seed": injection.seed,
        "detail": injection.detail,
        "seconds": injection.seconds,
        "lasted": injection.ended - injection.began,
        "interrupted": interrupted,
        "told": injection.told,
    }

"""`shsa check`: what is wrong with an ontology and a SOM."""
import argparse
import json
from dataclasses import asdict
from typing import Any

from shsa_core import message_types
from shsa_core.cli._common import say
from shsa_learning.cli._namespace import add_namespace
from shsa_learning.check import check_files
from shsa_learning.type_check import available


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "check",
        help="say what is wrong with an ontology and a SOM",
        description="Says what is wrong with an ontology and a SOM: file, line, what to do. "
        "Warnings alone leave a model valid.",
    )
    parser.add_argument("ontology", metavar="FILE", help="the ontology")
    parser.add_argument("--som", metavar="FILE", help="the service-to-ontology mapping")
    add_namespace(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(args: argparse.Namespace) -> int:
    """Print the findings. Returns 0 if the model is valid, 1 if it is not."""
    types = message_types if available() else None
    findings = check_files(args.ontology, args.som, types, args.namespace)
    errors = sum(finding.level == "error" for finding in findings)
    if args.json:
        answer = {"valid": not errors, "types_checked": types is not None and args.som is not None}
        print(json.dumps({**answer, "findings": [asdict(f) for f in findings]}, indent=2))
    else:
        if types is None and args.som is not None:
            say("types not checked: there is no ROS here")
        for finding in findings:
            say(finding)
        verdict = "not valid" if errors else "valid"
        say(f"{verdict}: {errors} errors, {len(findings) - errors} warnings")
    return 1 if errors else 0

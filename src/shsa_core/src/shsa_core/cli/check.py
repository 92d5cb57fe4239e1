"""`shsa check`: what is wrong with an ontology and a SOM."""
import argparse
import json
from dataclasses import asdict
from typing import Any

from shsa_core.analysis.check import check_files


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
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(args: argparse.Namespace) -> int:
    """Print the findings. Returns 0 if the model is valid, 1 if it is not."""
    findings = check_files(args.ontology, args.som)
    errors = sum(finding.level == "error" for finding in findings)
    if args.json:
        print(
            json.dumps({"valid": not errors, "findings": [asdict(f) for f in findings]}, indent=2)
        )
    else:
        for finding in findings:
            print(finding)
        verdict = "not valid" if errors else "valid"
        print(f"{verdict}: {errors} errors, {len(findings) - errors} warnings")
    return 1 if errors else 0

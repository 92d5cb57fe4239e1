"""`shsa import`: a knowledge base of the predecessor library as an ontology and a SOM.

The SOM is a draft.
"""
import argparse
import json
import os
from typing import Any, Dict, List, Sequence

from shsa_core.cli._common import say
from shsa_core.errors import ModelError
from shsa_learning.init.knowledge_base import Provision, read_knowledge_base
from shsa_learning.saving import save_ontology
from shsa_learning.whole_file import write_whole


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "import",
        help="convert a knowledge base of the predecessor library",
        description="Converts a knowledge base of the predecessor library to an ontology. "
        "Says what could not be taken over. Existing files are not written to.",
    )
    parser.add_argument("file", metavar="FILE", help="the knowledge base (YAML)")
    parser.add_argument("--ontology", metavar="FILE", required=True, help="the ontology to write")
    parser.add_argument(
        "--som", metavar="FILE", help="the draft of a SOM to write, with blanks to fill in"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(args: argparse.Namespace) -> int:
    """Write the files and print the notes. Returns 0."""
    for path in [args.ontology] + ([args.som] if args.som else []):
        if os.path.exists(path):
            raise ModelError(path, "is there already; give the name of a new file")
    base = read_knowledge_base(args.file)
    save_ontology(base.ontology, args.ontology)
    if args.som:
        write_whole(args.som, som_draft(base.provisions))
    if args.json:
        print(
            json.dumps({"ontology": args.ontology, "som": args.som, "notes": base.notes}, indent=2)
        )
        return 0
    for note in base.notes:
        say(note)
    ontology = base.ontology
    say(
        f"{args.ontology}: {len(ontology.properties)} properties, {len(ontology.constants)} "
        f"constants, {len(ontology.functions)} functions"
    )
    if args.som:
        say(
            f"{args.som}: {len(base.provisions)} services with blanks; fill them in, then: "
            f"shsa check {args.ontology} --som {args.som}"
        )
    return 0


def som_draft(provisions: Sequence[Provision]) -> str:
    """Return the text of a SOM file in which only what the knowledge base says is filled in."""
    lines: List[str] = [
        "# A draft: fill in the blanks. A topic may still have its field at the end: split it",
        "# (/odom/twist/twist/linear/x is the field twist.twist.linear.x of the topic /odom).",
        "# Values of one topic belong to one service: put them together. Where a field reads min()",
        "# or the like, the name of the array goes between the brackets: min(ranges).",
        "services:" if provisions else "services: {}",
    ]
    counts: Dict[str, int] = {}
    for provision in provisions:
        count = counts[provision.property] = counts.get(provision.property, 0) + 1
        name = provision.property if count == 1 else f"{provision.property}_{count}"
        quality = "" if provision.quality is None else f", quality: {provision.quality!r}"
        field = f"{provision.reduction}()" if provision.reduction else ""
        period = "" if provision.period is None else f" {provision.period!r}"
        topic = f" {json.dumps(provision.path)}" if provision.path else ""
        lines += [
            f"  {name}:",
            f"    topic:{topic}",
            "    type:",
            "    node:",
            f"    period:{period}",
            *(["    needed: true"] if provision.needed else []),
            "    provides:",
            f"      {provision.property}: {{field: {field}{quality}}}",
        ]
    return "\n".join(lines) + "\n"

"""`shsa explain`: what happened in an incident, as a page to read."""
import argparse
import os
import re
from pathlib import Path
from typing import Any, List, Optional, Sequence, Tuple

from shsa_learning.incident_log import read_log
from shsa_core.cli._common import say
from shsa_core.errors import ModelError
from shsa_core.healing.incident import Incident
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_learning.cli._common import read_models, whole_number
from shsa_learning.cli._namespace import add_namespace
from shsa_learning.explain.words import summary, title

MOST_PAGES = 1000
"""Of a log with more incidents, the newest are written."""


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "explain",
        help="tell what happened in an incident, as an HTML page",
        description="Tells what failed, why that was believed, what was searched, what was turned "
        "down and why, what ran, and how true it was. Reads the incident log or a rosbag; the "
        "models add what else there was, a bag and the models how true it was.",
    )
    parser.add_argument(
        "record", metavar="RUN.bag|INCIDENTS.jsonl", help="a rosbag, or the incident log"
    )
    parser.add_argument("--ontology", metavar="FILE", help="the ontology of that robot")
    parser.add_argument("--som", metavar="FILE", help="its service-to-ontology mapping")
    add_namespace(parser)
    parser.add_argument(
        "--incident", type=whole_number(1), metavar="N", help="only the incidents of this number"
    )
    parser.add_argument(
        "--output",
        metavar="FOLDER|PAGE.html",
        help="where the pages go: a folder, with an index, or the page of the one incident; else "
        "the incidents are told here, in short",
    )


def run(args: argparse.Namespace) -> int:
    """Write the pages. Returns 0, or 1 if there is no incident."""
    if (args.ontology is None) != (args.som is None):
        raise ModelError("--ontology and --som", "are given both, or neither")
    bag = _is_bag(args.record)
    told = _read(args.record, bag)
    incidents, notes = [*told.incidents], [*told.notes]
    if args.incident is not None:
        incidents = [each for each in incidents if each.id == args.incident]
    for note in notes:
        say(f"Note: {note}", error=True)
    if not incidents:
        which = "no incident" if args.incident is None else f"no incident {args.incident}"
        say(f"{args.record}: {which}")
        return 1
    if args.output is None:
        for incident in incidents:
            say(f"{incident.id}. {title(incident)}")
            for sentence in summary(incident):
                say(f"   {sentence}")
        return 0
    models = None
    if args.som is not None:
        models = read_models(args)
    if len(incidents) > MOST_PAGES:
        say(f"Note: only the newest {MOST_PAGES} of {len(incidents)} are written", error=True)
        incidents = incidents[-MOST_PAGES:]
    _write(args.output, incidents, args.record, told, models)
    return 0


def _is_bag(path: str) -> bool:
    from shsa_learning.recordings.bags import is_bag  # libraries of numbers load slowly

    return is_bag(path)


def _read(path: str, bag: bool) -> Any:
    if not bag:
        return read_log(path)
    from shsa_learning.explain.bag import read_healing

    return read_healing(path)


def _write(
    output: str,
    incidents: Sequence[Incident],
    record: str,
    told: Any,
    models: Optional[Tuple[Ontology, Som]],
) -> None:
    from shsa_learning.cli._explain_page import Record, index, page

    told_of = Record(record, told, models)
    if output.endswith(".html"):
        if len(incidents) > 1:
            raise ModelError("--output", f"{len(incidents)} incidents need a folder, or --incident")
        Path(output).write_text(page(told_of, incidents[0]), encoding="utf-8")
        say(output)
        return
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    names: List[Tuple[str, Incident]] = []
    for number, incident in enumerate(incidents, 1):
        name = f"{number:03}-{file_part(incident.service)}.html"
        (folder / name).write_text(page(told_of, incident), encoding="utf-8")
        names.append((name, incident))
    (folder / "index.html").write_text(index(record, names), encoding="utf-8")
    say(os.path.join(output, "index.html"))


def file_part(name: str) -> str:
    """Return a name from a record as a part of a file's name."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)[:60] or "incident"

"""`shsa init`: the draft of a SOM and an ontology from a running robot, or from a recording."""
import argparse
import importlib
import json
import os
import tempfile
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple

from shsa_core import message_types
from shsa_core.cli._common import say
from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.document import parse_yaml
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som, read_tree
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.ontology import Ontology, Property
from shsa_learning.cli._common import whole_number
from shsa_learning.init.again import drafted_path, widen
from shsa_learning.init.draft import UNLISTED, Draft, Listed, draft
from shsa_learning.init.prospects import obstacles
from shsa_learning.init.survey import Survey
from shsa_learning.whole_file import write_whole

if TYPE_CHECKING:
    from shsa_learning.init.expressing import Outcome

DONE, NOTHING = 0, 1


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "init",
        help="draft a SOM and an ontology of a running robot or a recording",
        description="Listens to a running robot, or reads a recording, and drafts a SOM and an "
        "ontology: topics, types, nodes, periods, ranges. Healing only advises by it: it is to "
        "be read and corrected. Without --som, --ontology and --json the SOM is printed.",
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--seconds",
        type=whole_number(1),
        default=20,
        metavar="N",
        help="listen to the running robot for so long (20)",
    )
    source.add_argument("--bag", metavar="FILE", help="read a recording; no master is needed")
    parser.add_argument("--som", metavar="FILE", help="the SOM to write")
    parser.add_argument("--ontology", metavar="FILE", help="the ontology to write")
    parser.add_argument(
        "--learn",
        action="store_true",
        help="with --bag and --ontology: learn which properties can be expressed by which others",
    )
    parser.add_argument(
        "--again",
        action="store_true",
        help="widen what was drafted into --som, and say what changed; what you wrote stays",
    )
    parser.add_argument("--force", action="store_true", help="overwrite files that are there")
    parser.add_argument("--json", action="store_true", help="print the survey as one document")


def run(args: argparse.Namespace) -> int:
    """Write the drafts. Returns 0, or 1 if no topic has a number: then nothing is written."""
    if args.again:
        return _again(args)
    paths = [path for path in (args.ontology, args.som) if path is not None]
    _check_paths(paths, args.force)
    if args.learn and (args.bag is None or args.ontology is None):
        raise ModelError(
            "--learn",
            "needs --bag, the recording of some minutes in which the robot does all that it can, "
            "and --ontology, the file that gets the relations",
        )
    survey, source, notes, listed = _survey(args)
    made = draft(survey, source, notes, listed)
    if not made.services:
        return _tell_nothing(survey, made, source, args)
    _check_paths(paths, args.force)  # another may have written them meanwhile
    for path, text in ((args.ontology, made.ontology), (args.som, made.som)):
        if path is not None:
            write_whole(path, text)
    if args.som is not None:
        write_whole(drafted_path(args.som), made.som)
    outcomes = _learn(args, made) if args.learn else []
    if args.json:
        document = {**_document(survey, made, args), "learned": list(map(_outcome, outcomes))}
        print(json.dumps(document, indent=2, allow_nan=False))
    elif paths:
        _tell(made, args)
        for outcome in outcomes:
            say(_told(outcome))
        for line in _obstacles(made, args.ontology):
            say(line)
    else:
        say(made.som.rstrip("\n"))
        for line in _obstacles(made, None):
            say(f"# {line}")
    return DONE


def _tell_nothing(survey: Survey, made: Draft, source: str, args: argparse.Namespace) -> int:
    """Say that there is nothing to draft, and what was left out, instead of empty files."""
    if args.json:
        args.som = args.ontology = None  # no file is written
        print(json.dumps(_document(survey, made, args), indent=2, allow_nan=False))
        return NOTHING
    for line in made.som.splitlines()[made.som.splitlines().index("services: {}") + 1 :]:
        say(line)
    todo = "Let the robot's nodes publish meanwhile" if args.bag is None else "Record its topics"
    say(f"shsa: nobody published a number in {source}: no draft is made. {todo}", error=True)
    return NOTHING


def _obstacles(made: Draft, ontology: Optional[str]) -> List[str]:
    """Return why nothing can be healed by the drafts; `ontology`: the file, as it was completed."""
    som, _ = read_tree(parse_yaml(made.som, "the draft"))
    som = with_unknowns(som, message_types.layout)
    if ontology is not None:
        return obstacles(read_ontology(ontology), som)
    names = sorted({source.property for source in som.sources})
    return obstacles(Ontology({name: Property(name) for name in names}, {}, ()), som)


def _again(args: argparse.Namespace) -> int:
    """Widen a draft. Returns 0, or 1 if nothing changed."""
    from shsa_learning.saving import dump, load

    if args.som is None or args.ontology is not None or args.learn:
        raise ModelError("--again", "needs --som, the draft to be widened, and that alone")
    copy = drafted_path(args.som)
    if os.path.isfile(args.som) and not os.path.lexists(copy):
        what = f"is not there: {args.som} as `shsa init` drafted it, to tell what you changed"
        raise ModelError(copy, f"{what}; rename both files alike")
    for path in (args.som, copy):
        read_som(path)
    som, drafted = load(args.som), load(copy)
    made = draft(*_survey(args))
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as fresh:
        fresh.write(made.som)
        fresh.flush()
        told = widen(som, drafted, load(fresh.name))
    dump(som, args.som)
    dump(drafted, copy)
    say("\n".join(told) or "nothing new was seen")
    return DONE if told else NOTHING


def _check_paths(paths: List[str], force: bool) -> None:
    """Raise ModelError before anybody waits for what cannot be written."""
    if len({os.path.realpath(path) for path in paths}) < len(paths):
        raise ModelError(paths[0], "SOM and ontology need a file each")
    for path in paths:
        if not os.path.isdir(os.path.dirname(os.path.abspath(path))):
            raise ModelError(path, "there is no such folder to write to")
        if os.path.lexists(path) and not (force and os.path.isfile(path)):
            raise ModelError(path, "is there already; give a new name, or --force to overwrite it")


def _survey(args: argparse.Namespace) -> Tuple[Survey, str, List[str], Listed]:
    """Return the survey, its source in words, notes, and what the master lists."""
    if args.bag is not None:
        survey = _shell("survey_bag").survey_bag(args.bag)
        return survey, f"{survey.seconds:.3g} s of {os.path.basename(args.bag)}", [], UNLISTED
    listen = _shell("survey").survey_robot
    survey, notes, listed = listen(float(args.seconds), lambda text: say(text, error=True))
    return survey, f"{args.seconds} s of a running robot", notes, listed


def _shell(name: str) -> Any:
    """Load a module that needs ROS. Raises ShsaError if there is none."""
    try:
        return importlib.import_module(f"shsa_learning.ros.{name}")
    except ImportError as error:
        raise ShsaError(f"init needs ROS: source its setup.bash ({error})") from error


def _learn(args: argparse.Namespace, made: Draft) -> "List[Outcome]":
    """Write the relations that the recording tells into the draft of the ontology."""
    # What fits takes a second to load, which no other command should wait for.
    from tqdm import tqdm

    from shsa_learning.init.expressing import express, with_all
    from shsa_learning.recordings.data import read
    from shsa_learning.saving import save_ontology

    som, _ = read_tree(parse_yaml(made.som, "the draft"))
    ontology = read_ontology(args.ontology)
    with tqdm(total=made.properties, desc="learning", leave=False, disable=None) as bar:
        source = os.path.basename(args.bag)
        outcomes = list(express(read([args.bag], som), som, source, bar.update))
    save_ontology(with_all(ontology, outcomes), args.ontology)
    return outcomes


def _told(outcome: "Outcome") -> str:
    relation = outcome.relation
    if relation is None:
        return f"{outcome.property}: {outcome.why}"
    rms = f"RMS error {relation.error.rms:.3g}" if relation.error is not None else ""
    return f"{outcome.property} by {', '.join(relation.inputs)}: {rms}"


def _outcome(outcome: "Outcome") -> Dict[str, Any]:
    relation = outcome.relation
    return {
        "property": outcome.property,
        "relation": relation.relation if relation is not None else None,
        "function": relation.text if relation is not None else None,
        "inputs": list(relation.inputs) if relation is not None else [],
        "rms": relation.error.rms if relation is not None and relation.error is not None else None,
        "reason": outcome.why,
    }


def _document(survey: Survey, made: Draft, args: argparse.Namespace) -> Any:
    return {
        "som": args.som,
        "ontology": args.ontology,
        "services": made.services,
        "properties": made.properties,
        **_plain(survey),
    }


def _plain(value: Any) -> Any:
    """Return a survey as mappings and lists."""
    if is_dataclass(value):
        return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
    if hasattr(value, "_asdict"):
        return {name: _plain(each) for name, each in value._asdict().items()}
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def _tell(made: Draft, args: argparse.Namespace) -> None:
    say(f"{made.services} services with {made.properties} properties; {made.left_out} left out")
    if args.som is not None:
        say(f"{args.som}: read it and correct it")
    if args.som is not None and args.ontology is not None:
        say(f"then: shsa check {args.ontology} --som {args.som}")

"""Options and lines of the commands."""
import argparse
import sys
from typing import Iterable, List, Tuple

from shsa_core import message_types
from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.conventions import with_unknowns
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.text import nearest, shown

LONGEST_PRINTED = 200_000
"""Characters of a printed line: the longest code has half of that."""


def say(text: object = "", error: bool = False) -> None:
    """Print lines; characters that could steer a terminal are escaped."""
    for line in str(text).split("\n"):
        print(shown(line, LONGEST_PRINTED), file=sys.stderr if error else sys.stdout)


def add_models(parser: argparse.ArgumentParser) -> None:
    """Add --ontology, --som and --namespace."""
    parser.add_argument("--ontology", metavar="FILE", required=True, help="the ontology")
    parser.add_argument(
        "--som", metavar="FILE", required=True, help="the service-to-ontology mapping"
    )
    add_namespace(parser)


def add_namespace(parser: argparse.ArgumentParser) -> None:
    """Add --namespace."""
    parser.add_argument(
        "--namespace",
        metavar="NAME",
        default="/",
        help="where relative names of topics and nodes are (/)",
    )


def add_without(parser: argparse.ArgumentParser) -> None:
    """Add --without."""
    parser.add_argument(
        "--without",
        metavar="NAME",
        action="append",
        default=[],
        help="do without this node, topic, service, host or common cause (fails_with) as well; "
        "may be given several times",
    )


def read_models(args: argparse.Namespace) -> Tuple[Ontology, Som]:
    """Read the files of the options, the SOM with what messages can say. Raises ModelError."""
    ontology, som = read_ontology(args.ontology), read_som(args.som, args.namespace)
    return ontology, with_unknowns(som, message_types.layout) if message_types.available() else som


def check_property(name: str, ontology: Ontology, som: Som) -> None:
    """Raise ModelError, with the nearest names, if no model has a property of this name."""
    check_known(
        name, "property", {*ontology.properties, *(source.property for source in som.sources)}
    )


def check_known(name: str, kind: str, known: Iterable[str]) -> None:
    """Raise ModelError, with the nearest names, if a name is not known."""
    if name not in known:
        raise ModelError(name, f"no such {kind}{_nearest(name, known)}")


def without(args: argparse.Namespace, som: Som) -> List[str]:
    """Return what --without names, as the SOM names it; warn of what is not in the SOM."""
    known = {name for source in som.sources for name in source.names}
    names = [som.known_name(name, args.namespace) for name in args.without]
    for name in names:
        if name not in known:
            text = f"no service in the SOM has the node or topic {name}{_nearest(name, known)}"
            say(f"shsa: {text}", error=True)
    return names


def _nearest(name: str, known: Iterable[str]) -> str:
    return nearest(name, known, 3) or f"; known are {', '.join(sorted(known))}"

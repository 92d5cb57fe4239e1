"""The options that name the ontology and the SOM, and what they name."""
import argparse
import difflib
import sys
from typing import Iterable, Tuple

from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add --ontology and --som."""
    parser.add_argument("--ontology", metavar="FILE", required=True, help="the ontology")
    parser.add_argument(
        "--som", metavar="FILE", required=True, help="the service-to-ontology mapping"
    )


def add_without(parser: argparse.ArgumentParser) -> None:
    """Add --without."""
    parser.add_argument(
        "--without",
        metavar="NODE|TOPIC",
        action="append",
        default=[],
        help="do without this node or topic as well; may be given several times",
    )


def read_models(args: argparse.Namespace) -> Tuple[Ontology, Som]:
    """The models that the options name. Raises ModelError."""
    return read_ontology(args.ontology), read_som(args.som)


def check_property(name: str, ontology: Ontology, som: Som) -> None:
    """Raises ModelError, with the nearest names, if neither model has a property of this name."""
    known = {*ontology.properties, *(source.property for source in som.sources)}
    if name not in known:
        raise ModelError(name, f"no such property{_nearest(name, known)}")


def services_of(topic: str, som: Som) -> Tuple[Service, ...]:
    """The services on a topic. Raises ModelError, with the nearest names, if there is none."""
    services = som.of_topic(topic)
    if not services:
        raise ModelError(
            topic, f"no service in the SOM has this topic{_nearest(topic, som.topics())}"
        )
    return services


def warn_of_unknown(names: Iterable[str], som: Som) -> None:
    """Say on stderr which names are no node, topic or service of the SOM."""
    known = {name for service in som for name in (service.name, service.node, service.topic)}
    for name in names:
        if name not in known:
            text = f"no service in the SOM has the node or topic {name}{_nearest(name, known)}"
            print(f"shsa: {text}", file=sys.stderr)


def _nearest(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, sorted(known), n=3)
    if near:
        return f"; did you mean {' or '.join(near)}?"
    return f"; known are {', '.join(sorted(known))}"

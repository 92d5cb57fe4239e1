"""The options that name the ontology and the SOM, and what they name."""
import argparse
import difflib
from typing import Iterable, List, Tuple

from shsa_core.cli._output import say
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
    """The models that the options name. Raises ModelError."""
    return read_ontology(args.ontology), read_som(args.som, args.namespace)


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


def service_of(name: str, som: Som) -> Service:
    """The service of a name. Raises ModelError, with the nearest names, if there is none."""
    service = som.services.get(name)
    if service is None:
        raise ModelError(name, f"no such service{_nearest(name, som.services)}")
    return service


def left_out(args: argparse.Namespace, som: Som) -> List[str]:
    """What --without names: services and common causes by name, topics and nodes by full name.

    Says on stderr what is none of them.
    """
    known = {name for source in som.sources for name in source.names}
    names = [som.known_name(name, args.namespace) for name in args.without]
    for name in names:
        if name not in known:
            text = f"no service in the SOM has the node or topic {name}{_nearest(name, known)}"
            say(f"shsa: {text}", error=True)
    return names


def _nearest(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, sorted(known), n=3)
    if near:
        return f"; did you mean {' or '.join(near)}?"
    return f"; known are {', '.join(sorted(known))}"

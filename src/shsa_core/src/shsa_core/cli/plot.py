"""`shsa plot`: a picture of an ontology and a SOM."""
import argparse
from typing import Any, Tuple

from shsa_core.analysis.loss import lose
from shsa_core.cli._files import add_options, check_property, read_models, warn_of_unknown
from shsa_core.errors import ModelError, NoSubstitute
from shsa_core.model.som import Service
from shsa_core.search.substitutes import find_substitute


def add_parser(subparsers: Any) -> None:
    """Adds the command."""
    parser = subparsers.add_parser(
        "plot",
        help="draw an ontology and a SOM",
        description="Draws properties and relations: provided, derivable, lost. With PROPERTY, "
        "what replaces it if the node that provides it fails is drawn in bold.",
    )
    parser.add_argument("property", metavar="PROPERTY", nargs="?", help="a property that is lost")
    add_options(parser)
    parser.add_argument(
        "--without",
        metavar="NODE|TOPIC",
        action="append",
        default=[],
        help="a node or topic that is lost as well; may be given several times",
    )
    parser.add_argument(
        "--output", metavar="FILE", default="ontology.svg", help="an .svg or .png (ontology.svg)"
    )


def run(args: argparse.Namespace) -> int:
    """Writes the picture. Returns 0, or 1 if the lost property has no substitute."""
    if not args.output.endswith((".svg", ".png")):
        raise ModelError("--output", f"{args.output} does not end in .svg or .png")
    ontology, som = read_models(args)
    warn_of_unknown(args.without, som)
    from shsa_core.cli._drawing import draw  # matplotlib takes a second

    left: Tuple[Service, ...] = tuple(
        s for s in som if s.node not in args.without and s.topic not in args.without
    )
    if args.property is None:
        draw(ontology, left, args.output)
        return 0
    check_property(args.property, ontology, som)
    loss = lose(som, args.property, args.without)
    title = f"{args.property} is lost"
    try:
        found = find_substitute(ontology, loss.available, args.property)
    except NoSubstitute:
        draw(ontology, loss.available, args.output, title=title + "; nothing replaces it")
        raise
    title += f"; its substitute has the quality {found.quality:.3g}"
    draw(ontology, loss.available, args.output, found.derivation, title)
    return 0

"""`shsa plot`: a picture of an ontology and a SOM."""
import argparse
from typing import Any

from shsa_core.analysis.loss import lose
from shsa_core.cli._drawing import draw
from shsa_core.cli._files import (
    add_options,
    add_without,
    check_property,
    left_out,
    read_models,
)
from shsa_core.codegen.choice import substitutes
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import ModelError, NoSubstitute
from shsa_core.search.substitutes import find_substitute


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "plot",
        help="draw an ontology and a SOM",
        description="Draws properties and relations: provided, derivable, lost. With PROPERTY, "
        "what replaces it if the node that provides it fails is drawn in bold.",
    )
    parser.add_argument("property", metavar="PROPERTY", nargs="?", help="a property that is lost")
    add_options(parser)
    add_without(parser)
    parser.add_argument(
        "--output", metavar="FILE", default="ontology.svg", help="an .svg or .png (ontology.svg)"
    )


def run(args: argparse.Namespace) -> int:
    """Write the picture. Returns 0, or 1 if the lost property has no substitute."""
    if not args.output.endswith((".svg", ".png")):
        raise ModelError("--output", f"{args.output} does not end in .svg or .png")
    ontology, som = read_models(args)
    args.without = left_out(args, som)
    available = [source for source in som.sources if set(args.without).isdisjoint(source.names)]
    derivation, title, none = None, "", None
    if args.property is not None:
        check_property(args.property, ontology, som)
        loss = lose(som, args.property, args.without)[0]
        available = list(loss.available)
        title = f"{args.property} is lost"
        try:
            found = find_substitute(ontology, available, args.property)
        except NoSubstitute as error:
            none, title = error, f"{title}; nothing replaces it"
        else:
            derivation = found.derivation
            expected = None
            knows = predictor(ontology, som.sources)
            if knows is not None:
                found, expected = next(substitutes(ontology, available, args.property, knows))
                derivation = found.derivation
            title = f"{title}; its substitute has the quality {found.quality:.3g}"
            if expected is not None:
                title = f"{title} and the expected error {expected.rms:.3g}"
    picture = draw(ontology, available, args.output[-3:], derivation, title)
    with open(args.output, "wb") as file:
        file.write(picture)
    if none is not None:
        raise none
    return 0

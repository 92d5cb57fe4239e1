"""`shsa plot`: a picture of an ontology and a SOM, drawn by graphviz."""
import argparse
import html
import subprocess
from pathlib import Path
from typing import Any, Dict, Iterable, List, Optional, Set, Tuple, Union

from shsa_core.cli._common import say
from shsa_core.codegen.prediction import predictor
from shsa_core.errors import ModelError, NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_core.text import shown
from shsa_learning.cli._common import add_models, add_without, check_property, read_models, without
from shsa_learning.loss import lose, ranked
from shsa_learning.substitutes import find_substitute

Edge = Tuple[str, str]

COLOURS = {"provided": "#b8e0b8", "derivable": "#bcd6f2", "lost": "#f4b6b0"}
FONT = "Helvetica,Arial,sans-serif"
GREY = "#808080"
MOST_NODES = 1000
TIMEOUT_S = 60.0
STYLE = f"""
  rankdir=TB; nodesep=0.18; ranksep=0.4; pad=0.2; fontname="{FONT}"; fontsize=13; labelloc=b;
  node [fontname="{FONT}", fontsize=11, margin="0.12,0.05", height=0.3];
  edge [color="{GREY}", arrowsize=0.7];
"""
RELATION = 'shape=ellipse, style=filled, fillcolor=white, margin="0.02,0.01", height=0.2'


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "plot",
        help="draw an ontology and a SOM",
        description="Draws properties and relations: provided, derivable, lost. With PROPERTY, "
        "what replaces it if the node that provides it fails is drawn in bold.",
    )
    parser.add_argument("property", metavar="PROPERTY", nargs="?", help="a property that is lost")
    add_models(parser)
    add_without(parser)
    parser.add_argument(
        "--output", metavar="FILE", default="ontology.svg", help="an .svg or .png (ontology.svg)"
    )


def run(args: argparse.Namespace) -> int:
    """Write the picture. Returns 0, or 1 if the lost property has no substitute."""
    if not args.output.endswith((".svg", ".png")):
        raise ModelError("--output", f"{args.output} does not end in .svg or .png")
    ontology, som = read_models(args)
    names = without(args, som)
    available = [source for source in som.sources if set(names).isdisjoint(source.names)]
    derivation, title, none = None, "", None
    if args.property is not None:
        check_property(args.property, ontology, som)
        loss = lose(som, args.property, names)[0]
        available = list(loss.available)
        title = f"{args.property} is lost"
        try:
            find_substitute(ontology, available, args.property)
        except NoSubstitute as error:
            none, title = error, f"{title}; nothing replaces it"
        else:
            errors = predictor(ontology, som.sources)
            found, expected = next(ranked(ontology, loss, errors))
            derivation = found.derivation
            title += f"; its substitute has the quality {found.quality:.3g}"
            title += f" and the expected error {expected.rms:.3g}" if expected is not None else ""
    picture = draw(ontology, available, args.output[-3:], derivation, title)
    Path(args.output).write_bytes(picture)
    say(args.output)
    if none is not None:
        raise none
    return 0


class CannotDraw(ModelError):
    """The model has more parts than can be drawn, or graphviz cannot draw it here."""


def draw(
    ontology: Ontology,
    available: Iterable[Source],
    format: str,
    substitution: Optional[Derivation] = None,
    title: str = "",
) -> bytes:
    """Return the picture as `svg` or `png`, with a substitution in bold. Raises CannotDraw."""
    text = dot_text(ontology, available, substitution, title)
    try:
        return subprocess.run(
            ["dot", f"-T{format}"],
            input=text.encode(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            timeout=TIMEOUT_S,
            check=True,
        ).stdout
    except FileNotFoundError:
        raise CannotDraw("the drawing", "needs the program 'dot'; install graphviz") from None
    except subprocess.TimeoutExpired:
        raise CannotDraw("the drawing", f"dot takes more than {TIMEOUT_S:g} s for it") from None
    except subprocess.CalledProcessError as error:
        raise CannotDraw("the drawing", f"dot says: {error.stderr.decode().strip()}") from None


def dot_text(
    ontology: Ontology,
    available: Iterable[Source],
    substitution: Optional[Derivation] = None,
    title: str = "",
) -> str:
    """Return the picture in the language of graphviz. Raises CannotDraw if it is too large."""
    sources: Dict[str, List[Source]] = {name: [] for name in ontology.properties}
    for source in available:
        sources.setdefault(source.property, []).append(source)
    size = len(sources) + len(ontology.functions)
    if size > MOST_NODES:
        raise CannotDraw(
            "the drawing", f"{size} properties and functions; at most {MOST_NODES} can be read"
        )
    states = _states(ontology, sources)
    bold = _bold(substitution)
    used = {node for edge in bold for node in edge}
    lines = [_label(title, substitution is not None)]
    for name, own in sources.items():
        node = _id(name)
        attributes = f'shape=box, style="filled,rounded", fillcolor="{COLOURS[states[name]]}"'
        lines.append(_node(node, _property(name, own, node in used), attributes, node in used))
    for each in ontology.graph:
        if isinstance(each, tuple):
            text = f"<i>{_escaped(each[0])}</i>"
            lines.append(_node(_id(each), text, RELATION, _id(each) in used))
    lines += [_edge((_id(start), _id(end)), bold) for start, end in ontology.graph.edges]
    return "digraph {" + STYLE + "\n".join(lines) + "\n}\n"


def _states(ontology: Ontology, sources: Dict[str, List[Source]]) -> Dict[str, str]:
    network = ontology.network
    table = SourceTable(network, [source for own in sources.values() for source in own])
    best = BestDerivations(table)
    states = {}
    for name, own in sources.items():
        derivable = own or best.settle(network.number(name))
        states[name] = "provided" if own else "derivable" if derivable else "lost"
    return states


def _id(node: Union[str, Tuple[str, ...]]) -> str:
    """Return the name in the picture of a node of the ontology's graph."""
    return f"p {node}" if isinstance(node, str) else f"r {node[0]} {node[1]}"


def _bold(substitution: Optional[Derivation]) -> Set[Edge]:
    bold: Set[Edge] = set()
    for part in substitution.unique() if substitution is not None else ():
        if part.function is not None:
            relation = _id((part.function.relation, part.function.output))
            bold.add((relation, _id(part.property)))
            bold.update((_id(input_.property), relation) for input_ in part.inputs)
    return bold


def _property(name: str, sources: Iterable[Source], used: bool) -> str:
    """Return a property's name, and below it in small the paths and hosts that provide it."""
    places = (f"{s.path} on {s.service.host}" if s.service.host else s.path for s in sources)
    paths = (f'<br/><font point-size="9">{_escaped(place)}</font>' for place in places)
    label = f"<b>{_escaped(name)}</b>" if used else _escaped(name)
    return label + "".join(paths)


def _node(node: str, text: str, attributes: str, used: bool) -> str:
    line = "penwidth=2" if used else f'color="{GREY}"'
    return f"  {_quoted(node)} [label=<{text}>, {attributes}, {line}];"


def _edge(edge: Edge, bold: Set[Edge]) -> str:
    start, end = map(_quoted, edge)
    return f"  {start} -> {end}" + (
        " [penwidth=2.5, color=black, weight=4];" if edge in bold else ";"
    )


def _label(title: str, with_substitution: bool) -> str:
    """Return the title and the legend of the colours."""
    cells = [
        f'<td bgcolor="{colour}" border="1" color="{GREY}">  </td><td>{word}  </td>'
        for word, colour in COLOURS.items()
    ]
    cells += ["<td><b>→</b></td><td>the substitution</td>"] if with_substitution else []
    key = f'<table border="0" cellspacing="4"><tr>{"".join(cells)}</tr></table>'
    rows = f"<tr><td>{_escaped(title)}</td></tr>" if title else ""
    return f'  label=<<table border="0">{rows}<tr><td>{key}</td></tr></table>>;'


def _escaped(text: str) -> str:
    return html.escape(shown(text))


def _quoted(text: str) -> str:
    return '"' + shown(text).replace("\\", "\\\\").replace('"', '\\"') + '"'

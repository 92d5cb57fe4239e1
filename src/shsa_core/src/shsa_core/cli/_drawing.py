"""Draws an ontology and a SOM with graphviz: what is provided, derivable and lost."""
import html
import subprocess
from typing import Dict, Iterable, Iterator, List, Optional, Set, Tuple, Union

from shsa_core.errors import ModelError
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.search.best import BestDerivations
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_core.text import shown

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


class CannotDraw(ModelError):
    """The model has more parts than can be drawn, or graphviz cannot draw it here."""


def draw(
    ontology: Ontology,
    available: Iterable[Source],
    format: str,
    substitution: Optional[Derivation] = None,
    title: str = "",
) -> bytes:
    """The picture in a format of graphviz, `svg` or `png`, with a substitution in bold.

    Raises CannotDraw.
    """
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
    """The picture in the language of graphviz. Raises CannotDraw if it is too large."""
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
    best = BestDerivations(
        network, SourceTable(network, [source for own in sources.values() for source in own])
    )

    def state(name: str) -> str:
        if sources[name]:
            return "provided"
        return "derivable" if best.settle(network.number(name)) else "lost"

    return {name: state(name) for name in sources}


def _id(node: Union[str, Tuple[str, ...]]) -> str:
    """Return the name in the picture of a node of the ontology's graph."""
    return f"p {node}" if isinstance(node, str) else f"r {node[0]} {node[1]}"


def _bold(substitution: Optional[Derivation]) -> Set[Edge]:
    """The edges of the substitution."""
    bold: Set[Edge] = set()
    for part in substitution.unique() if substitution is not None else ():
        if part.function is not None:
            relation = _id((part.function.relation, part.function.output))
            bold.add((relation, _id(part.property)))
            bold.update((_id(input_.property), relation) for input_ in part.inputs)
    return bold


def _property(name: str, sources: Iterable[Source], used: bool) -> str:
    """A property's name, and below it in small where it is provided, and on which host."""
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
    """The title, and what the colours mean."""

    def cells() -> Iterator[str]:
        for word, colour in COLOURS.items():
            yield f'<td bgcolor="{colour}" border="1" color="{GREY}">  </td><td>{word}  </td>'
        if with_substitution:
            yield "<td><b>→</b></td><td>the substitution</td>"

    key = f'<table border="0" cellspacing="4"><tr>{"".join(cells())}</tr></table>'
    rows = f"<tr><td>{_escaped(title)}</td></tr>" if title else ""
    return f'  label=<<table border="0">{rows}<tr><td>{key}</td></tr></table>>;'


def _escaped(text: str) -> str:
    """A text in a label."""
    return html.escape(shown(text))


def _quoted(text: str) -> str:
    return '"' + shown(text).replace("\\", "\\\\").replace('"', '\\"') + '"'

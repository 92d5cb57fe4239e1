"""The ontology and the services as a drawing, laid out once: the browser only switches classes."""
import html
import subprocess
from typing import Any, Collection, Dict, Iterable, Iterator, List, Tuple

from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology, TransferFunction
from shsa_core.model.som import Som
from shsa_core.text import shown

MOST_ELEMENTS = 1000
TIMEOUT_S = 30.0
STYLE = """
  rankdir=TB; nodesep=0.2; ranksep=0.4; pad=0.2; bgcolor=transparent;
  node [fontname="sans-serif", fontsize=11, margin="0.12,0.05", height=0.3, color=gray50];
  edge [color=gray50, arrowsize=0.7];
"""


def functions_for(ontology: Ontology, name: str) -> Tuple[TransferFunction, ...]:
    """Return the functions that yield the property `name`, in order of their relations."""
    graph = ontology.graph
    nodes = sorted(graph.predecessors(name)) if name in graph else ()
    return tuple(graph.nodes[node]["function"] for node in nodes)


def property_id(name: str) -> str:
    """Return the id of a property."""
    return f"property-{name}"


def service_id(name: str) -> str:
    """Return the id of a service."""
    return f"service-{name}"


def relation_id(relation: str, output: str) -> str:
    """Return the id of the direction of a relation that yields a property."""
    return f"relation-{relation}-{output}"


def elements(
    ontology: Ontology,
    som: Som,
    lost: Iterable[str],
    relations: Collection[str],
    inputs: Collection[str],
) -> List[str]:
    """Return the elements by which a substitute computes lost properties, its inputs first.

    `relations` are the names of those that it uses, `inputs` the paths that it reads.
    """
    found: Dict[str, None] = {}
    open_ = list(lost)
    while open_:
        name = open_.pop(0)
        if property_id(name) in found:
            continue
        found[property_id(name)] = None
        read = [source for source in som.of_property(name) if source.path in inputs]
        found.update({service_id(source.service.name): None for source in read})
        for function in () if read else functions_for(ontology, name):
            if function.relation in relations:
                found[relation_id(function.relation, name)] = None
                open_ += function.inputs
    return list(found)


Edge = Tuple[str, str]


def edges(ontology: Ontology, som: Som) -> List[Edge]:
    """Return the edges: services to properties, these by relations to others."""
    provided = ((service_id(s.service.name), property_id(s.property)) for s in som.sources)
    return list(dict.fromkeys([*provided, *_of_relations(ontology)]))


def _of_relations(ontology: Ontology) -> Iterator[Edge]:
    for function in ontology.functions:
        relation = relation_id(function.relation, function.output)
        for name in function.inputs:
            if name not in ontology.constants:
                yield property_id(name), relation
        yield relation, property_id(function.output)


def dot_text(ontology: Ontology, som: Som) -> str:
    """Return the drawing in the language of graphviz. Raises ShsaError if it is too large."""
    names = dict.fromkeys((*ontology.properties, *(each.property for each in som.sources)))
    size = len(names) + len(ontology.functions) + len(som)
    if size > MOST_ELEMENTS:
        raise ShsaError(f"{size} properties, relations and services; at most {MOST_ELEMENTS}")
    lines = [_node(service_id(s.name), s.name, s.topic, "service", "box") for s in som]
    for name in names:
        known = ontology.properties.get(name)
        unit = known.unit if known else ""
        lines.append(_node(property_id(name), name, unit, "property", 'box, style="rounded"'))
    for function in ontology.functions:
        relation = relation_id(function.relation, function.output)
        lines.append(_node(relation, function.relation, "", "relation", "ellipse"))
    for number, (start, end) in enumerate(edges(ontology, som)):
        what = f'id="edge-{number}", class="edge"'
        lines.append(f"  {_quoted(start)} -> {_quoted(end)} [{what}];")
    return "digraph {" + STYLE + "\n".join(lines) + "\n}\n"


def drawing(ontology: Ontology, som: Som) -> Dict[str, Any]:
    """Return the drawing as SVG, and its edges with the elements that they join.

    `error`: why there is none.
    """
    joined = [
        {"id": f"edge-{number}", "from": start, "to": end}
        for number, (start, end) in enumerate(edges(ontology, som))
    ]
    try:
        return {"svg": _svg(dot_text(ontology, som)), "edges": joined, "error": ""}
    except ShsaError as error:
        return {"svg": "", "edges": joined, "error": str(error)}


def _svg(text: str) -> str:
    """Run graphviz. Raises ShsaError if it cannot draw."""
    command = ["dot", "-Tsvg"]
    try:
        done = subprocess.run(
            command, input=text.encode(), capture_output=True, timeout=TIMEOUT_S, check=True
        )
    except FileNotFoundError as error:
        raise ShsaError("the drawing needs the program 'dot'; install graphviz") from error
    except subprocess.TimeoutExpired as error:
        raise ShsaError(f"dot takes more than {TIMEOUT_S:g} s for the drawing") from error
    except subprocess.CalledProcessError as error:
        raise ShsaError(f"dot says: {shown(error.stderr.decode().strip())}") from error
    svg = done.stdout.decode()
    return svg[svg.index("<svg") :]


def _node(id_: str, name: str, below: str, kind: str, shape: str) -> str:
    label = html.escape(shown(name))
    if below:
        label += f'<br/><font point-size="9">{html.escape(shown(below))}</font>'
    what = f'id={_quoted(id_)}, class="{kind}", tooltip={_quoted(name)}, shape={shape}'
    return f"  {_quoted(id_)} [label=<{label}>, {what}];"


def _quoted(text: str) -> str:
    return '"' + shown(text).replace("\\", "\\\\").replace('"', '\\"') + '"'

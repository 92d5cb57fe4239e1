"""Draws an ontology and a SOM: what is provided, derivable and lost, and a substitution in bold."""
import shutil
import subprocess
from typing import Dict, Iterable, List, Mapping, Optional, Set, Tuple, Union

import matplotlib

matplotlib.use("Agg")

import networkx as nx  # noqa: E402
from matplotlib import pyplot  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402

from shsa_core.errors import ModelError  # noqa: E402
from shsa_core.model.ontology import Ontology  # noqa: E402
from shsa_core.model.som import Service  # noqa: E402
from shsa_core.search.best import BestDerivations  # noqa: E402
from shsa_core.search.derivation import Derivation, ServiceTable  # noqa: E402

Node = Union[str, Tuple[str, str]]
Position = Tuple[float, float]

COLOURS = {"provided": "#b8e0b8", "derivable": "#bcd6f2", "lost": "#f4b6b0"}
MOST_NODES = 1000
LAYOUT_TIMEOUT = 20.0  # s, after which a plainer layout is taken


class TooLarge(ModelError):
    """The model has more parts than can be drawn."""


def draw(
    ontology: Ontology,
    available: Iterable[Service],
    path: str,
    substitution: Optional[Derivation] = None,
    title: str = "",
) -> None:
    """Writes the picture to `path`; its ending, `.svg` or `.png`, is the format. Raises TooLarge."""
    services = tuple(available)
    graph = ontology.graph()
    graph.add_nodes_from((s.property for s in services), kind="property")
    if len(graph) > MOST_NODES:
        raise TooLarge(
            "the drawing", f"{len(graph)} properties and functions; at most {MOST_NODES}"
        )
    labels = _labels(graph, services)
    states = _states(ontology, services, graph)
    bold = _bold(substitution)
    positions, (width, height) = _layout(graph, labels)
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "shsa"}):
        figure = pyplot.figure(figsize=(width, height + 1))
        axes = figure.add_axes([0, 0, 1, 1])
        axes.set_axis_off()
        axes.set_xlim(0, width)
        axes.set_ylim(-0.6, height + 0.4)
        used = {node for edge in bold for node in edge}
        boxes = {}
        for node, kind in graph.nodes(data="kind"):
            relation = kind == "relation"
            boxes[node] = axes.text(
                *positions[node],
                labels[node],
                ha="center",
                va="center",
                fontsize=7 if relation else 8,
                fontstyle="italic" if relation else "normal",
                fontweight="bold" if node in used else "normal",
                bbox={
                    "boxstyle": "round,pad=0.2" if relation else "square,pad=0.35",
                    "facecolor": "white" if relation else COLOURS[states[node]],
                    "edgecolor": "black" if node in used else "#707070",
                    "linewidth": 2 if node in used else 0.7,
                },
                zorder=2,
            )
        figure.canvas.draw()  # only now do the boxes know their sizes, at which the arrows end
        for start, end in graph.edges:
            strong = (start, end) in bold
            axes.annotate(
                "",
                positions[end],
                positions[start],
                arrowprops={
                    "arrowstyle": "-|>",
                    "color": "black" if strong else "#909090",
                    "linewidth": 2.5 if strong else 0.7,
                    "patchA": boxes[start].get_bbox_patch(),
                    "patchB": boxes[end].get_bbox_patch(),
                },
                zorder=1,
            )
        keys = [
            Line2D([], [], marker="s", linestyle="", color=colour, markersize=9, label=name)
            for name, colour in COLOURS.items()
        ]
        if substitution is not None:
            keys.append(Line2D([], [], color="black", linewidth=2.5, label="the substitution"))
        axes.legend(handles=keys, loc="lower left", ncol=4, frameon=False, fontsize=8)
        if title:
            axes.text(width / 2, height + 0.1, title, ha="center", fontsize=9)
        figure.savefig(path, metadata={"Date": None} if path.endswith(".svg") else None)
        pyplot.close(figure)


def _labels(graph: nx.DiGraph, services: Iterable[Service]) -> Dict[Node, str]:
    """A relation's name; a property's name and the topics that provide it."""
    labels = {n: n[0] if kind == "relation" else n for n, kind in graph.nodes(data="kind")}
    for service in services:
        labels[service.property] += "\n" + service.path
    return labels


def _states(ontology: Ontology, services: Iterable[Service], graph: nx.DiGraph) -> Dict[Node, str]:
    network = ontology.network
    numbers = {n: network.number(n) for n, kind in graph.nodes(data="kind") if kind == "property"}
    best = BestDerivations(network, ServiceTable(network, services))
    provided = {service.property for service in services}
    states: Dict[Node, str] = {}
    for name, number in numbers.items():
        derivable = best.settle(number)
        states[name] = "provided" if name in provided else "derivable" if derivable else "lost"
    return states


def _bold(substitution: Optional[Derivation]) -> Set[Tuple[Node, Node]]:
    """The edges of the substitution."""
    bold: Set[Tuple[Node, Node]] = set()
    for part in substitution.unique() if substitution is not None else ():
        if part.function is not None:
            relation = part.function.relation, part.function.output
            bold.add((relation, part.property))
            bold.update((input_.property, relation) for input_ in part.inputs)
    return bold


def _layout(
    graph: nx.DiGraph, labels: Mapping[Node, str]
) -> Tuple[Dict[Node, Position], Tuple[float, float]]:
    """Where each node stands, and the size of the picture, in inches: by `dot` where that is installed."""
    layout = _by_dot(graph, labels) if shutil.which("dot") and graph else None
    if layout is not None:
        return layout
    side = max(4.0, 1.8 * len(graph) ** 0.5)
    raw = nx.spring_layout(graph, seed=1, center=(0.5, 0.5), scale=0.42)
    width = 1.6 * side
    positions = {n: (float(x) * width, float(y) * side) for n, (x, y) in raw.items()}
    return positions, (width, side)


def _by_dot(
    graph: nx.DiGraph, labels: Mapping[Node, str]
) -> Optional[Tuple[Dict[Node, Position], Tuple[float, float]]]:
    names = {node: f"n{i}" for i, node in enumerate(graph)}
    lines = ["digraph {", "rankdir=LR; nodesep=0.15; ranksep=0.5; margin=0.3; node [shape=box];"]
    for node, name in names.items():
        rows = labels[node].split("\n")
        width = 0.2 + 0.075 * max(map(len, rows))
        lines.append(f'{name} [label="", width={width:.2f}, height={0.15 + 0.16 * len(rows):.2f}];')
    lines += [f"{names[start]} -> {names[end]};" for start, end in graph.edges]
    try:
        done = subprocess.run(
            ["dot", "-Tplain"],
            input="\n".join(lines + ["}"]),
            stdout=subprocess.PIPE,
            universal_newlines=True,
            timeout=LAYOUT_TIMEOUT,
            check=True,
        )
    except (subprocess.SubprocessError, OSError):
        return None
    nodes = {name: node for node, name in names.items()}
    positions: Dict[Node, Position] = {}
    size = (1.0, 1.0)
    for line in done.stdout.splitlines():
        words: List[str] = line.split()
        if words[0] == "graph":
            size = float(words[2]) + 0.6, float(words[3]) + 0.6
        elif words[0] == "node":
            positions[nodes[words[1]]] = float(words[2]) + 0.3, float(words[3]) + 0.3
    return positions, size

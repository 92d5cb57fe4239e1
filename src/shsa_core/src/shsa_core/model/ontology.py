"""The ontology: properties and the relations between them (Section III-B of the paper)."""
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Mapping, Optional, Sequence, Tuple

from shsa_core.model.network import Network
from shsa_core.model.relation import TransferFunction

if TYPE_CHECKING:
    import networkx as nx


@dataclass(frozen=True)
class Property:
    """A quantity of the robot. `unit` is its unit as text, `""` if it is not known.

    `usual`: the lowest and highest value that it usually has, None: not known; `where`: file and
    line.
    """

    name: str
    unit: str = ""
    symbol: str = ""
    where: str = field(default="", compare=False, repr=False)
    usual: Optional[Tuple[float, float]] = None


@dataclass(frozen=True)
class Constant:
    """A property that never changes; `value` in `unit`."""

    name: str
    value: float
    unit: str = ""
    where: str = field(default="", compare=False, repr=False)


@dataclass(frozen=True)
class Ontology:
    """Properties, constants and relations; immutable once made."""

    properties: Mapping[str, Property]
    constants: Mapping[str, Constant]
    functions: Sequence[TransferFunction]
    network: Network = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "network", Network(self.properties, self.functions))

    def functions_for(self, name: str) -> Tuple[TransferFunction, ...]:
        """The transfer functions that yield the property `name`, by the name of their relation."""
        return self.network.functions_for(name)

    def graph(self) -> "nx.DiGraph":
        """The bipartite graph of properties (`kind="property"`) and functions (`kind="relation"`).

        A property's node is its name; a function's node is the pair (relation, output).
        Edges follow the data: input property -> function -> output property.
        """
        import networkx as nx  # takes a third of a second: only who draws or analyses pays for it

        graph = nx.DiGraph()
        graph.add_nodes_from(self.properties, kind="property")
        for function in self.functions:
            node = (function.relation, function.output)
            graph.add_node(node, kind="relation", quality=function.quality)
            graph.add_edges_from((name, node) for name in function.inputs)
            graph.add_edge(node, function.output)
        return graph

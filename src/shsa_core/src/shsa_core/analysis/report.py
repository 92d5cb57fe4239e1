"""What the resilience analysis says."""
from dataclasses import dataclass
from typing import Optional, Tuple


@dataclass(frozen=True)
class Alternative:
    """The best derivation of a lost property by one relation, or by another source of it.

    `by` is the relation's name or the source's path, `inputs` the paths read, `nodes` those that
    publish them.
    """

    property: str
    by: str
    quality: float
    inputs: Tuple[str, ...]
    nodes: Tuple[str, ...]


@dataclass(frozen=True)
class ServiceReport:
    """A needed service, and what is left of it when its node fails.

    `quality` of its best substitute, None if there is none; `reads`, the nodes that it needs;
    `missing`, what it lacks; `alternatives` for each of its properties, the best first; `cuts`, the
    smallest sets of nodes whose failure together loses the service.
    """

    service: str
    topic: str
    node: str
    properties: Tuple[str, ...]
    quality: Optional[float]
    reads: Tuple[str, ...]
    missing: Tuple[str, ...]
    alternatives: Tuple[Alternative, ...]
    cuts: Tuple[Tuple[str, ...], ...]


@dataclass(frozen=True)
class NodeReport:
    """What the loss of a node costs.

    `lost`: its needed services that nothing replaces; `healed`: those with a substitute, and its
    quality; `leaned_on`: needed services of other nodes whose best substitute reads this node.
    """

    node: str
    lost: Tuple[str, ...]
    healed: Tuple[Tuple[str, float], ...]
    leaned_on: Tuple[str, ...]


@dataclass(frozen=True)
class Cut:
    """A smallest set of nodes whose failure together loses needed services, and which."""

    nodes: Tuple[str, ...]
    services: Tuple[str, ...]


@dataclass(frozen=True)
class Survival:
    """The share of failures of one node, and of two at once, that lose no needed service.

    `double` is None where it was not worked out.
    """

    single: float
    double: Optional[float]


@dataclass(frozen=True)
class Suggestion:
    """A new sensor or a new relation for a property, and what the robot then survives.

    `source` is the input of the relation.
    """

    property: str
    source: Optional[str]
    survival: Survival


@dataclass(frozen=True)
class Report:
    """How resilient a robot is."""

    services: Tuple[ServiceReport, ...]
    nodes: Tuple[NodeReport, ...]
    cuts: Tuple[Cut, ...]
    survival: Survival
    sensor: Optional[Suggestion]
    relation: Optional[Suggestion]

"""The report of the resilience analysis."""
from dataclasses import dataclass
from math import comb
from typing import Optional, Tuple

from shsa_core.model.error import Error


@dataclass(frozen=True)
class Alternative:
    """The best derivation of a lost property by one relation, or by another source of it.

    `by` is the relation's name or the source's path, `inputs` the paths read, `nodes` those that
    publish them; `error`: what is expected, in the property's unit, None: not known.
    """

    property: str
    by: str
    quality: float
    inputs: Tuple[str, ...]
    nodes: Tuple[str, ...]
    error: Optional[Error] = None


@dataclass(frozen=True)
class ServiceReport:
    """A needed service, and what is left of it when its node fails.

    `quality` of its best substitute, None if there is none; `errors`, what is expected of each of
    its properties, in the order and unit of these, None: not known; `reads`, the causes that this
    needs; `missing`, what it lacks; `refused`, why there is none although nothing is missing;
    `alternatives` for each of its properties, the best first; `cuts`, the smallest sets of causes
    whose failure together loses the service. A cause is a node, or what services fail with.
    """

    service: str
    topic: str
    node: str
    properties: Tuple[str, ...]
    quality: Optional[float]
    reads: Tuple[str, ...]
    missing: Tuple[str, ...]
    refused: str
    alternatives: Tuple[Alternative, ...]
    cuts: Tuple[Tuple[str, ...], ...]
    errors: Tuple[Optional[Error], ...] = ()


@dataclass(frozen=True)
class NodeReport:
    """The cost of losing a node, or whatever else services fail with.

    `lost`: its needed services that nothing replaces; `healed`: those with a substitute, and its
    quality; `leaned_on`: needed services of other nodes whose best substitute reads this node.
    """

    node: str
    lost: Tuple[str, ...]
    healed: Tuple[Tuple[str, float], ...]
    leaned_on: Tuple[str, ...]


@dataclass(frozen=True)
class Cut:
    """A smallest set of causes whose failure together loses needed services, and which."""

    nodes: Tuple[str, ...]
    services: Tuple[str, ...]


@dataclass(frozen=True)
class Survival:
    """The share of failures of one cause, and of two at once, that lose no needed service.

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
    """The resilience of a robot.

    `exact` names what was looked for among all that there is: `sensor`, `relation`. The other is
    the best of those that seemed worth a look. `late`: the services that are healed later than they
    tolerate, each with the sums; `unfit`: those whose substitutes do not fit where they would run.
    """

    services: Tuple[ServiceReport, ...]
    nodes: Tuple[NodeReport, ...]
    cuts: Tuple[Cut, ...]
    survival: Survival
    sensor: Optional[Suggestion]
    relation: Optional[Suggestion]
    exact: Tuple[str, ...]
    late: Tuple[str, ...] = ()
    unfit: Tuple[str, ...] = ()


def survival(causes: int, alone: int, pairs: Optional[int]) -> Survival:
    """Return the shares survived, if `alone` causes and `pairs` of them lose something.

    The pairs include those of which one is fatal alone.
    """
    both = comb(causes, 2)
    double = None if pairs is None else (both - pairs) / both if both else 1.0
    return Survival((causes - alone) / causes if causes else 1.0, double)

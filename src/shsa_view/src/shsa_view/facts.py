"""Facts about the robot: plain values, whatever message or file they came in.

All times in s of ROS time; None: not known.
"""
from dataclasses import dataclass, field
from typing import Mapping, Optional, Tuple, Union

from shsa_core.healing.incident import Incident
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.model.substitution import shared_key

SILENT_S = 4.0
"""Healers tell of themselves once a second; with a busy computer one or two of these are late."""


@dataclass(frozen=True)
class Publisher:
    """The health of a publisher of a topic; `state`, `kind` as in shsa_msgs/PublisherHealth."""

    topic: str
    publisher: str
    state: str
    kind: str = ""
    detail: str = ""
    last_good: Optional[float] = None


@dataclass(frozen=True)
class Running:
    """One service of the running SOM, as the reconfigurator tells it."""

    service: str
    topic: str
    node: str
    period: float
    needed: bool
    available: bool
    detail: str = ""


@dataclass(frozen=True)
class Substitute:
    """One process that stands in for a service, or stands by for it (`publishing`: not).

    Without a node it is a plan. Inputs and outputs are paths; `error_rms` and `error_p95` are those
    of each output. `shared`: others run in the same node.
    """

    node: str
    service: str
    publishing: bool
    inputs: Tuple[str, ...] = ()
    outputs: Tuple[str, ...] = ()
    relations: Tuple[str, ...] = ()
    code: str = ""
    quality: float = 0.0
    host: str = ""
    error_rms: Tuple[Optional[float], ...] = ()
    error_p95: Tuple[Optional[float], ...] = ()
    shared: bool = False

    @property
    def key(self) -> str:
        """The key of its row in the table."""
        return shared_key(self.node, self.service) if self.shared else self.node or self.service


@dataclass(frozen=True)
class HealthTold:
    """The table of one monitor, or what changed in it; `removed` are pairs of topic and publisher.

    `monitor` is that monitor's computer, empty: that of all others.
    """

    monitor: str
    rows: Tuple[Publisher, ...]
    removed: Tuple[Tuple[str, str], ...] = ()
    whole: bool = True


@dataclass(frozen=True)
class ServicesTold:
    """The running SOM, or what changed in it."""

    rows: Tuple[Running, ...]
    removed: Tuple[str, ...] = ()
    whole: bool = True


@dataclass(frozen=True)
class SubstitutesTold:
    """The table of substitutions, or what changed in it."""

    rows: Tuple[Substitute, ...]
    removed: Tuple[str, ...] = ()
    whole: bool = True


@dataclass(frozen=True)
class IncidentTold:
    """A step of an incident.

    `logged`: it was read from the log, so that nobody works on it unless it is told again.
    """

    incident: Incident
    logged: bool = False


@dataclass(frozen=True)
class Figures:
    """A service on /diagnostics, for display: rates in Hz by publisher, newest values.

    `values` are by property, in its unit; `bridged`: how often a late message was filled in for.
    """

    service: str
    rates: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    bridged: int = 0


@dataclass(frozen=True)
class FiguresTold:
    """The services in one message on /diagnostics."""

    rows: Tuple[Figures, ...]


@dataclass(frozen=True)
class DutiesTold:
    """The duties of a service's node beyond the SOM, in words; empty: it has none."""

    service: str
    duties: str


@dataclass(frozen=True)
class CommandsTold:
    """The commands by which nodes were started, as seen on this computer while they ran."""

    commands: Mapping[str, str]


@dataclass(frozen=True)
class Healer:
    """The state of `monitor`, `monitor_HOST`, `reconfigurator` or `master`: alive, lost or unknown.

    `connected`: once it is again, it tells anew whatever is still true.
    """

    name: str
    state: str
    text: str = ""
    connected: bool = True


@dataclass(frozen=True)
class MaintenanceTold:
    """The robot is maintained, or is so no more: healing kills and starts nothing meanwhile."""

    on: bool


@dataclass(frozen=True)
class HostTold:
    """The state of a computer of the robot: heard, lost or unknown."""

    name: str
    state: str
    text: str = ""


@dataclass(frozen=True)
class TrustTold:
    """The check of signatures of what is shown: `checked`, `refused` or `unchecked`."""

    state: str
    text: str = ""


@dataclass(frozen=True)
class ModelsRead:
    """The ontology and the SOM, read from their files."""

    ontology: Ontology
    som: Som


Fact = Union[
    HealthTold,
    ServicesTold,
    SubstitutesTold,
    IncidentTold,
    FiguresTold,
    DutiesTold,
    CommandsTold,
    Healer,
    MaintenanceTold,
    HostTold,
    TrustTold,
    ModelsRead,
]


def presence(connected: bool, ever: bool, silent: Optional[float]) -> Tuple[str, str]:
    """Return the state of a healer, `alive`, `lost` or `unknown`, and what is wrong in words.

    `connected`: it sends us a table; `ever`: it did at some time; `silent`: s since it was heard.
    """
    if not connected:
        return ("lost", "it is gone") if ever else ("unknown", "it was not heard yet")
    if silent is not None and silent > SILENT_S:
        return "lost", f"it has said nothing for {silent:.0f} s"
    return "alive", ""

"""What the healing of one service is told about the rest of the robot, each time that it decides.
"""
from dataclasses import dataclass
from typing import Callable, FrozenSet, Mapping, Optional, Tuple, Union

from shsa_core.codegen.plans import Plan
from shsa_core.healing.events import Command
from shsa_core.healing.containment import Verdict
from shsa_core.healing.kills import KillNode
from shsa_core.healing.placement import Place
from shsa_core.healing.planner import AnyPlan, Planner
from shsa_core.healing.pool import Spare
from shsa_core.healing.settings import Settings
from shsa_core.healing.sharing import Shared
from shsa_core.model.kinds import BY_LINK, Kind, Standby
from shsa_core.model.service import Service
from shsa_core.monitoring.events import PublisherHealth

Request = Union[Command, KillNode]
"""What the healing of a service wants done: the reconfigurator makes one kill of several."""


@dataclass(frozen=True)
class Snapshot:
    """The robot at `time`, as far as `service` is concerned.

    `publishers` of its topic, by name; `watched`: whether a monitor tells of them. `originals` are
    those of the service that are no substitutes. `killing`: the nodes whose kill is under way.
    `incident`: the number of a new incident. `place`: the computer for a plan, `spare`: an idle
    process there, if there is one for this service; `fresh`: the name of a new one. At most one of
    the two is taken each time. `verdict` decides about a faulty node: its name, the kind of
    failure, whether something takes the service over, and whether the node would be started again.
    `parted`: whether a cut may part the substitute from us or from the original.
    `share`: the process that a hot substitute shares; None: it has its own.
    `room`: whether a process may be started now that no failure needs; else it is asked later.
    `awaited`: whether a node that comes back may bring another service that nothing else gives.
    `far`: the service's node is on another computer, behind a link.
    """

    time: float
    service: Service
    settings: Settings
    planner: Planner
    publishers: Mapping[str, PublisherHealth]
    watched: bool
    originals: Tuple[PublisherHealth, ...]
    killing: FrozenSet[str]
    incident: int
    place: Callable[[AnyPlan], Place]
    spare: Callable[[str], Spare]
    fresh: str
    verdict: Callable[[str, Kind, bool, bool], Verdict]
    awaited: Callable[[str], bool]
    parted: bool
    room: Callable[[], bool]
    share: Callable[[Plan], Optional[Shared]]
    far: bool = False

    def by_link(self, kind: Kind) -> bool:
        """Whether a failure of the service's node may be one of its link."""
        return self.far and kind in BY_LINK

    @property
    def hot(self) -> bool:
        """Whether a substitute of the service computes before it is needed."""
        service = self.service
        return service.needed and service.standby is Standby.HOT and service.policy.substitutes

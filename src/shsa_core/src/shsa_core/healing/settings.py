"""The reconfigurator's settings: times and limits."""
from dataclasses import dataclass, field

from shsa_core.codegen.plans import METHODS
from shsa_core.model.service import Deadlines


@dataclass(frozen=True)
class Settings:
    """The reconfigurator's settings; times in s.

    `hold_off`: how long a returned original must stay healthy before the substitute is stopped.
    `hold_off_limit`: what `hold_off` doubles up to while an original keeps failing. `relapse`: an
    original that fails within so many times `hold_off` of its return, or within its own hold-off,
    has relapsed. `switches`: after how many relapses in a row it is kept out; 0: never. `healings`:
    how often a service may be healed in a minute before it is given up; 0: any number will do.
    `start_timeout`: how long a substitute may take from its start to its first message.
    `takeover_timeout`: the same for a process that runs already; then another one gets its work.
    `restarts`: how often a substitute that died is started again with the same plan.
    `node_restarts`, `restart_pause`: how often a node is started again, and the first pause, which
    doubles. `restart_timeout`: how long a node that was started again may take to its first
    message. `stable`: how long a node must be well until its restarts are forgotten. `retry`: after
    how long a service that could not be healed is tried anew. `retry_limit`: what that doubles to.
    `method`: the search, `best` or `depth_first` (the paper's `orr`). `pool`: how many idle
    processes the warm services share. `kill_patience`: how long a node that may still publish may
    take to leave before its process is ended. `hot_hosts`: so many hot substitutes have a process
    each; those beyond share processes of so many at most; 0: each has its own, however many they
    are. `takeover_cold`, `takeover_warm`, `takeover_hot`:
    what a takeover is taken to last where a service's `fault_tolerant_time` is checked; by default
    the 95th percentile of 50 takeovers at a roscpp consumer (docs/experiments.md). `deadline`,
    `minimum_deadline`: as the monitor's: periods, and s, after which values are stale.
    """

    hold_off: float = 2.0
    hold_off_limit: float = 60.0
    relapse: float = 5.0
    switches: int = 3
    healings: int = 0
    start_timeout: float = 5.0
    takeover_timeout: float = 2.0
    restarts: int = 2
    node_restarts: int = 3
    restart_pause: float = 0.5
    restart_timeout: float = 10.0
    stable: float = 60.0
    retry: float = 2.0
    retry_limit: float = 60.0
    method: str = field(default="best", metadata={"one_of": METHODS})
    pool: int = field(default=2, metadata={"most": 100})
    hot_hosts: int = field(default=20, metadata={"most": 1000})
    kill_patience: float = 0.1
    takeover_cold: float = 0.83
    takeover_warm: float = 0.03
    takeover_hot: float = 0.03
    deadline: float = Deadlines.periods
    minimum_deadline: float = Deadlines.minimum

    @property
    def deadlines(self) -> Deadlines:
        """When values are stale."""
        return Deadlines(self.deadline, self.minimum_deadline)

"""The reconfigurator's times and limits: each with its unit and its reason."""
from dataclasses import dataclass

from shsa_core.agenda import doubled
from shsa_core.model.service import Deadlines


@dataclass(frozen=True)
class Settings:
    """The reconfigurator's settings; times in s."""

    # What a user sets.
    hold_off: float = 2.0  # that a node that is back must stay healthy; each relapse doubles it
    switches: int = 3  # relapses in a row after which a node is kept out; 0: they do not count
    node_restarts: int = 3  # times that a node is started again
    method: str = "best"  # of the search
    pool: int = 2  # idle processes for the warm services
    # Hot substitutes that have a process each; those beyond share some of so many; 0: none shares.
    hot_hosts: int = 20
    minimum_deadline: float = Deadlines.minimum  # as the monitor's: after it a value is stale

    # What tests and benches set.
    hold_off_limit: float = 60.0  # that `hold_off` doubles up to
    relapse: float = 5.0  # times `hold_off`: a node that fails so soon after its return relapses
    restarts: int = 2  # times that a substitute that died is started again with the same plan
    restart_pause: float = 0.5  # before a node is started again; it doubles
    restart_timeout: float = 10.0  # that a restarted node may take to its first message
    stable: float = 60.0  # that a node must be well until its restarts are forgotten
    retry: float = 2.0  # after which a service that could not be healed is tried again; it doubles
    retry_limit: float = 60.0  # that `retry` doubles up to
    kill_patience: float = 0.1  # that a node has to leave where the SOM says `contain: node`

    @property
    def deadlines(self) -> Deadlines:
        """Return when values are stale."""
        return Deadlines(self.minimum_deadline)

    def held_off(self, times: int) -> float:
        """Return the hold-off in s of what has relapsed so many times."""
        return doubled(self.hold_off, times, max(self.hold_off, self.hold_off_limit))

    def paused(self, times: int) -> float:
        """Return the pause in s before what failed is tried once more, after so many tries."""
        return doubled(self.retry, times, max(self.retry, self.retry_limit))


# That a monitor has to send its table when its computer seems lost; and a reconfigurator to give a
# sign of life: then the first idle process takes over by itself, each further one as much later.
ANSWER_S = 0.5

# How a node is ended.
FIND_TIMEOUT_S = 2.0  # that the search for a node's process may take
# To answer and for a process to end; as roslaunch: after it was asked, and after SIGTERM.
EXIT_TIMEOUT_S, LEAVE_S, TERM_S = 1.0, 15.0, 2.0
LISTEN_S, LISTEN_PERIODS = 0.5, 3.0  # that a node is counted on its own computer: the longer

# Processes of substitutes.
TAKEOVER_S = 2.0  # that a process that runs already may take to its first message

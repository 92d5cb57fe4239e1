"""The monitor's settings, where a service has none of its own, and the constants of its core."""
from dataclasses import dataclass

from shsa_core.model.service import Deadlines


@dataclass(frozen=True)
class Settings:
    """The monitor's settings.

    `startup_grace`: s until a service that has never been there has failed.
    `deadline`: periods without a message after which a publisher is silent.
    `minimum_deadline`: s; the least silence that it is blamed for by that.
    """

    startup_grace: float = 15.0
    deadline: float = Deadlines.periods
    minimum_deadline: float = Deadlines.minimum

    @property
    def deadlines(self) -> Deadlines:
        """How long a service may be silent."""
        return Deadlines(self.deadline, self.minimum_deadline)


# Alibis. Times in s.
CONNECT_S = 0.1
"""A silence may come of a connection of healing's own that was made in it, or so long before."""
COMING_UP_S = 1.0
"""The same of a substitute that comes up: it has more to do after that, and so have others."""
RECONNECT_S = 0.5
"""A node whose connection was lost, and which lives, gives another one within this; and a new
monitor connects within this to who is there."""
SUBSCRIBE_S = 0.01
"""The same for each topic: connections of one are made while others are subscribed."""
TOGETHER_NODES = 3
"""So many nodes that are late at the same time are late for one reason."""
TOGETHER_S = 5.0
"""So long several nodes that are not heard together count as not connected yet."""
MISSED_PERIODS = 1.5
"""Who is silent for so many periods has missed a message."""
SLOW_PACE = 0.8
"""Of its rate: half way to what counts as too low where the SOM says nothing."""
LOOK_S = 0.1
"""Who is slow is looked at so often: every message of a slow node asks for it."""
REMEMBERED = 200
"""Connections, and gaps, that are remembered."""

# Calibration: what a value is compared with. Times in s.
SAMPLE_S = 0.2
"""Between two comparisons: those in between cost time and tell nothing new."""
SAMPLE_COUNTS_S = 1.0
"""A sample tells of the time since the one before, up to this; errors are noted so far apart."""
MEMORY_S = 200.0
"""What is older counts less than 1/e."""
LARGEST = 1e100
"""The square of a value beyond could be infinite, and its table of calibrations refused."""
GUARD_S = 5.0
"""A sample is learned once it is so old, as long as nothing was doubted since; and no error is
noted before something was learned for as long."""
SETTLING_S = 60.0
"""Of data, before which gain and offset are free; the gain needs as much that tells of it."""
PRIOR_GAIN = 0.3
"""The standard deviation of a relation's gain from 1 that is expected."""
EXCITED = 2.0
"""A gain is believed once the variance of what is derived is so many times the residual's."""
GAINS = 0.5, 2.0
"""The smallest and the largest gain."""
DRIFT_S = 300.0
"""In it a settled offset moves by the relation's rms error at most, a gain by GAIN_STEP."""
GAIN_STEP = 0.05
DRIFTS = 3.0
"""So many times that is as far as they ever move."""
ERRORS, FEWEST_ERRORS = 300, 5
"""An error is that of so many samples at most, and not known before there were a few."""

# Which plans are calibrated, and what is told of them.
PLANS = 3
"""At most of one service: the best, and those for a second failure."""
REPLAN_S = 5.0
"""Between two looks at which services are there."""
SEARCH_S = 0.5
"""Between two searches for a plan: on a robot of 500 services one takes 50 ms."""
EVALUATIONS_PER_S = 2000.0
"""Of all programs together: what is beyond that is not followed."""
REFRESH_S, REFRESHES_PER_S = 1.0, 100.0
"""Between two looks at what a program has learned; and so many of all programs in a second."""
GAP_PERIODS = 5.0
"""A program that remembers forgets after a gap of so many periods of its service."""
TOLD_SHARE = 0.1
"""A calibration is told anew if it moves its values by this share of their rms error."""

# Witnesses.
WITNESS_LOOKS = 10
"""Looks, SAMPLE_S apart: two values differ by the mean of so many, and that has to last as long."""
WITNESS_SAMPLES = 60
"""So many samples, one a second, make an error known that nobody has stated."""
WITNESS_MEMORY_S = 120.0
"""Errors count as they were so long ago: a sensor that drifts widens them by and by."""
SPREAD_RMS, SPREAD_P95 = 4.0, 2.0
"""A value may be so many rms, and so many times its p95, from the truth."""

"""The monitor's settings, where a service has none of its own, and the constants of its core."""
from dataclasses import dataclass

from shsa_core.model.service import Deadlines


@dataclass(frozen=True)
class Settings:
    """The monitor's settings."""

    startup_grace: float = 15.0  # s until a service that has never been there has failed
    minimum_deadline: float = Deadlines.minimum  # s; the least silence that is blamed

    @property
    def deadlines(self) -> Deadlines:
        """The silence that services are allowed."""
        return Deadlines(self.minimum_deadline)


# Alibis.
RECONNECT_S = 0.5
"""A node whose connection was lost, and which lives, gives another one within this; and a new
monitor connects within this to who is there."""
SHORT_SHARE = 0.5
"""Of the time in which something waits for a processor: with less, healthy streams came in time.
So it is with what the threads of one node wait together: at 0.6 of its rate one waited for 0.9."""
TOGETHER_NODES = 3
"""So many nodes that are late at the same time are late for one reason."""
TOGETHER_S = 10.0
"""Nodes that fail one after the other within this may do so for one reason, as load is."""
MISSED_PERIODS = 1.5
"""A publisher that is silent for so many periods has missed a message."""
SLOW_PACE, FULL_PACE = 0.8, 0.9
"""Of its rate: half way to what counts as too low where the SOM says nothing, and half of that."""
REMEMBERED = 200
"""Gaps that are remembered."""

# Evidence.
RATE_MESSAGES, RATE_SECONDS = 20, 1.0
"""A rate is taken over so many messages, or over so many seconds' worth if these are more."""
COMES_AND_GOES = 3
"""So many times must a fault have gone away before it counts as one that comes and goes. Then it is
over only after so many times the longest such gap."""
LEARN_MESSAGES = 200
"""So many tell what is usual of a value, and if stamps always grow; and a signal that went through
0 so often reads 0 as any value."""

# Stamps.
AGES = 50
"""So many messages tell how old stamps usually are, which frames they name, how long arrays are."""
AGE_FOLLOWS = 6e-4
"""The usual age follows by so much a second: ntpd sets a clock by 5e-4, and queues fill by more."""
AGE_LEAST_S, AGE_PERIODS, AGE_SPREADS, AGE_SHARE = 0.5, 10.0, 3.0, 0.96
"""A stamp may differ by this, by so many periods or by so many times what this share did at most
while learning, whichever is most. A clock that changes by half of the first from one look to the
next was set, and with more between two clocks stamps of one tell little on the other."""

# Values that stand still.
STILL_FACTOR, STILL_LEAST_S = 10, 1.0
"""A run must be so many times longer than the longest one that was seen, and than this."""
MOST_REPEATS = 0.1
"""Of the messages, may have the value of the one before: noise of about three steps has as many."""
LEAST_TURNS = 0.25
"""Of the changes go the other way than the one before: with white noise two in three do."""
FORGET_MESSAGES = 10000
"""Counts are halved then: the noise may become another one. The longest run is never forgotten."""

# Learned deadlines.
TAIL_KEPT = 100
"""So many of the longest gaps of each block are kept: all that is beyond them is a count."""
TAIL = 20
"""One gap in so many, at most, is tail."""
BLOCK_S, BLOCKS = 1800.0, 4
"""Of the stream: what was seen in the oldest block is forgotten when a new one begins."""
LEARN_GAPS, LEARN_SHARE = 1000, 1e-3
"""So many gaps, and so much of the mean time between false alarms, must have been seen."""
SPARE = 1.5
"""The longest healthy gap of the blocks is always allowed, so many times over."""

# What is kept and told.
MESSAGES_KEPT = 20
"""Of each publisher: the evidence against it begins with one of the last `of`."""
LAST_MESSAGE_B = 65536
"""A larger message is not kept: it would travel in a table."""
OLDEST_MESSAGE_S = 60.0
"""An older message is not handed out."""
BRIDGES_APART = 2.0
"""After so many of a substitute's bridges without a message of its it is another time."""

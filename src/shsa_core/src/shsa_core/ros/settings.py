"""Times and bounds of the shells: each with its unit and its reason.

Modules name them as `settings.NAME`, so that a test can set one for all its users.
"""

# Turns: how long a thread that handles events waits at most.
TURN_S = 0.1
"""No longer between two looks at the clock: it bounds how late a message is known to have come."""

# Threads for calls that wait for others.
STANDING_WORKERS = 2
"""Always there: a call is made even where no thread can be started any more."""
IDLE_WORKER_S = 10.0
"""A thread beyond these ends when it has had nothing to do for so long."""
SAY_AGAIN_S = 10.0
"""Between two lines of the log on the same trouble."""

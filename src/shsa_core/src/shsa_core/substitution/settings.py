"""The numbers by which a substitute decides: each with its unit, and why it is so."""

# When it computes and publishes.
SHORTEST_SHARE = 0.5
"""Of the period: no two messages or evaluations are closer; a derivative would be a wild one."""
MADE_UP_S = 0.02
"""A message that is late by no more loses no slot. What is later was a stall: no burst follows."""
REST_S = 0.25
"""Between two evaluations of a muted program that remembers nothing: has it still a value?"""
MISSES, FIRST_MISSES = 2, 10
"""Evaluations in a row without a value that are told, after a first value and before: filters need
a few samples."""
ANGLES_KEPT = 250
"""Computed angles: as long as a failure takes to be seen, at 100 Hz."""

# When it fills in for an original that is late.
STEADY = 5
"""Messages in a row, none later than what is bridged, that make a steady pace."""
LATE, FADES = 1.8, 0.998
"""Times the longest silence of late between two messages, of which each takes its share: so long is
a message of a regular stream waited for, at most for `bridge`."""
LOOK_AGAIN_S = 0.05
"""Between two looks whether the original's connection stands; by then the reconfigurator has
spoken about one that has ended, and who is to fill in in less than half of it does not wait."""
ALONE_LOOKS = 100
"""It goes on for so many more if a healer was not there: another one starts within 2 s."""

# When it hands consumers over to an original that is back.
LOOK_S = 0.01
"""The least time between two looks at whom the original serves: each is a call to its node."""

# When it advertises and withdraws.
ANNOUNCE_S = (0.05, 0.15, 0.35, 0.75, 1.55, 3.15)
"""After advertising, those are told again who have not connected; without a hurry three times."""
WITHDRAW_DELAY_S, WITHDRAW_PAUSE_S = 0.2, 0.05
"""After a takeover, and between two topics: each has others close a connection."""

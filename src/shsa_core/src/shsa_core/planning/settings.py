"""The numbers by which plans are made and placed: each with its reason."""

# Computers. Times in s.
CERTAIN_S = 2.0
"""That a computer is heard beside a node's silence before that is the node's own."""
SETTLE_S = 2.0
"""Computers come one after the other: then what stands by is placed anew."""
MISSED_S = 1.5
"""A computer that was not heard for so long was cut off, though nobody said so."""
STRAINED = 0.9
"""Of its cores busy: more makes well nodes slow."""

# Plans.
STEPS = 10_000
"""Functions that are looked at while something has failed."""
RECALLED = 20
"""Plans, best first, among which one of a former reconfigurator is looked for."""
ENOUGH = 60
"""Samples until a new monitor knows more of a calibration than the one before."""

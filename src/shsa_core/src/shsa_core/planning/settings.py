"""The numbers by which plans are made and placed; times in s."""

# That a computer is heard until a node's silence is the node's own; who was not heard for so long
# was cut off, though nobody said so. Computers come one after the other: then what stands by is
# placed anew.
CERTAIN_S = 2.0
STRAINED = 0.9  # of its cores busy: more makes well nodes slow

STEPS = 10_000  # functions that are looked at while something has failed
RECALLED = 20  # plans, best first, among which one of a former reconfigurator is looked for
CHANGED = 0.2  # by this share an error is another one: plans are not to change all the time
ENOUGH = 100  # samples, 40 s, until a new monitor knows more of a calibration than the one before

# Processes.
START_S = 5.0  # that a process may take to come up, and to its first message
LONGEST_START_S = 20.0  # on a busy computer; what has lived so long comes up, and stays
AT_ONCE = 2  # come up at a time: each costs most of a core until it is heard

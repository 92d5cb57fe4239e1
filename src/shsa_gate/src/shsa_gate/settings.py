"""The numbers by which a gate decides: each with its unit, and why it is so."""

LATE = 1.5
"""Periods after the last message: the substitute speaks. A healthy node is rarely later."""
OLD = 2.0
"""Periods: a substitute's value is not heard any more, and a gate that said nothing is missed."""
LEAST_PATIENCE_S = 0.05
"""A gate is missed no sooner: a busy computer costs as much."""
APART = 0.5
"""Of the period: two voices are no closer."""
BURST = 5.0
"""Messages of a publisher that is too fast, which pass at once."""
JUDGED_LOOKS = 30
"""Of the monitor, after which its witnesses have spoken: it needs two rounds of ten, and healing
has to hear of that. A substitute without a period that is silent for as long tells nothing new."""
CLOCK_SET_NS = 10**9
"""A stamp that goes back by more is of a clock that was set."""

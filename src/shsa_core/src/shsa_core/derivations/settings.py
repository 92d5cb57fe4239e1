"""The numbers by which derivations are learned and compared: each with its reason."""

# What a value is compared with. Times in s.
SAMPLE_S = 0.2
"""Between two comparisons, and two counts of slow nodes: those in between tell nothing new."""
SAMPLE_COUNTS_S = 1.0
"""A sample tells of the time since the one before, up to this."""
MEMORY_S = 200.0
"""Samples that are older count less than 1/e."""
LARGEST = 1e100
"""The square of a value beyond could be infinite, and its table of calibrations refused."""
GUARD_S = 5.0
"""A sample is learned once it is so old, as long as nothing was doubted since; and no error is
noted before something was learned for as long."""
SETTLING_S = 60.0
"""Of data, before which gain and offset are free; the gain needs as much that tells of it. For
witnesses errors are known then, and count as they were twice as long ago: a sensor that drifts
widens them."""
EXCITED = 2.0
"""A gain is believed once the variance of what is derived is so many times the residual's."""
GAINS = 0.5, 2.0
"""The smallest and the largest gain."""
DRIFT_S = 300.0
"""In it a settled offset moves by the relation's rms error at most, a gain by GAIN_STEP."""
GAIN_STEP = 0.05
AS_STATED = 1.5
"""Times the stated error: a relation that has no more is not calibrated before it settles."""
CHANGES_PER_HOUR = 2.0
"""Of load, floor or battery, after which what was learned of a gain holds no more."""
SEEN = 3.0
"""Standard deviations within which a value is as it was seen: beyond, nobody knows the gain."""
SAME_PULL = 0.5
"""Two derivations are pulled the same way by a sensor that drifts: one at least half as much."""
ERRORS_APART = 2
"""Samples, SAMPLE_S each, between two errors that are noted: fewer would miss short transients."""
ERRORS, FEWEST_ERRORS = 750, 12
"""An error is that of so many samples at most, and not known before there were a few."""

# Which plans are calibrated, and what is told of them.
PLANS = 4
"""At most of one service: the best, those for a second failure, and those that watch it."""
SEARCH_S = 0.5
"""Between two searches for a plan: on a robot of 500 services one takes 50 ms."""
EVALUATIONS_HZ = 2000.0
"""Of all programs together: what is beyond that is not followed."""
REFRESH_S = 2.0
"""Between two looks at what a program has learned, one takes 60 us, at the gaps of a stream, and at
which services are there."""
TOLD_SHARE = 0.1
"""A calibration is told anew if it moves its values by this share of their rms error."""

# Fusion.
FUSED = 300
"""Errors at the same moments, of 120 s, tell shares; and so many later ones judge them."""
FUSED_GAIN = 0.95
"""A fusion must err no more than this times the best of its parts."""
FUSED_BLOCKS = 5
"""Of the time in which it is judged: in each it must be no worse than the best part."""
SHRINKAGE, LEAST_SHARE = 0.9, 0.1
"""So much of the covariance of two errors counts, as few tell it; and the smallest share."""

# Witnesses.
WITNESS_LOOKS = 10
"""Looks, SAMPLE_S apart: two values differ by the mean of so many, and that has to last as long."""

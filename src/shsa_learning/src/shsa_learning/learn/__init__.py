"""Relations, learned from rows of recorded data."""

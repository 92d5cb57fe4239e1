"""The ranges of values: where a function may have none."""

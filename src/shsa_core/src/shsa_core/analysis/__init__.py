"""What can be said of a model before it is relied on: whether it is sound, and what it survives."""

"""Records the events of a machine in a file, and makes the same decisions again."""

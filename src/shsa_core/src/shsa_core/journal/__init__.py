"""What a machine heard, line by line in a file, and the same decisions made again."""

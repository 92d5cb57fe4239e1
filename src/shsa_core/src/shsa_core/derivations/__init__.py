"""What others tell of a value: derived by the relations, learned, and compared."""

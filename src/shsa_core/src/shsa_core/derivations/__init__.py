"""Derivations: what others tell of a value by the relations; learned, and compared."""

"""Derivations, run on recorded data as their substitutes would have been."""

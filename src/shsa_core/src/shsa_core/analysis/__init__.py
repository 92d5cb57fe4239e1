"""Checks a model before it is relied on, and what it survives."""

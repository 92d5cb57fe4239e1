"""Recordings: read, aligned, learned from, and what derivations are worth on them."""

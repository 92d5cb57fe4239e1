"""Fault injection: makes a topic of a running system fail in a known way, and takes that back."""

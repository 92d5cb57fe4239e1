"""Connections to publishers, read by one thread as bytes."""

"""Connections to publishers, read by one thread as bytes: `subscriptions` is where to begin."""

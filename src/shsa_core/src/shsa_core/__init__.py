"""Self-healing by structural adaptation."""

__version__ = "0.1.0"

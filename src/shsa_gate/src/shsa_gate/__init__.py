"""The gate: what the consumers of a service hear, message by message."""

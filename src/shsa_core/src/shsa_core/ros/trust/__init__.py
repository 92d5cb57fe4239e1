"""Signatures, secrets, and the computers whose messages are believed."""

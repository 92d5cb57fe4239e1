"""Analyse how resilient a robot is, and what would help most."""

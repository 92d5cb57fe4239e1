"""Judges how each publisher of each topic is doing."""

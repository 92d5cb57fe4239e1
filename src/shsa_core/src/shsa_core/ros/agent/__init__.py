"""Whoever carries out what healing wants done with the processes of one computer."""

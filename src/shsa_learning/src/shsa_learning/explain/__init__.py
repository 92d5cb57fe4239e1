"""Incidents, explained after the fact: the reason, the alternatives, the truth."""

"""Plans: what would take a service over, and where; for healing, and for `shsa check`."""

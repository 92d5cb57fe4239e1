"""Other computers: what is said to their agents and by them, and both ends of that conversation."""

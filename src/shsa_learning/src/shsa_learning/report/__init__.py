"""How resilient a robot is, and what would help most."""

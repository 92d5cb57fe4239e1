"""Commands to other computers: `routing` sends each to its own, `agent` runs there."""

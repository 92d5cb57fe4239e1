"""The robot's computers: `all_hosts` sends each command to its own, `agent` runs on the others."""

"""The fault model's scoreboard, proven on real processes: `make reliability`."""

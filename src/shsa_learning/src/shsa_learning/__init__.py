"""Models of a robot: drafted from what it publishes, learned from recordings, tested, explained."""

"""The survey of a running robot, and of a bag."""

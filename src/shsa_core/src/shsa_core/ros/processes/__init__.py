"""Processes of the robot and of healing: learned, started, watched and ended."""

"""The shells: the only part that knows ROS.

They bring events to the core, and carry out what it decides.
"""

"""The shells, the only part that knows ROS: they bring events in, and carry commands out."""

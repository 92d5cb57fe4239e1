"""What is known of the robot: properties, relations, and which topics provide what."""

"""The model of the robot: properties, relations, and which topics provide them."""

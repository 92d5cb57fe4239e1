"""Code that runs inside the node whose messages are made to fail."""

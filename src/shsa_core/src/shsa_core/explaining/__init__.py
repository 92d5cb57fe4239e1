"""What can be told of an incident afterwards: why, what else there was, and how true it was."""

"""What can be told of an incident once it is over: why, what else there was, and how true it was."""

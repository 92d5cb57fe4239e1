"""The command line `shsa`."""

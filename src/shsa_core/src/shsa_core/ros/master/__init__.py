"""The master's calls, and what nodes answer to theirs."""

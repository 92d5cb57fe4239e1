"""Recorded data, from bags and CSV files, as series on one clock."""

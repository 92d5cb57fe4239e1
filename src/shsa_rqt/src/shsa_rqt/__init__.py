"""A plugin for rqt that shows what the live view serves."""

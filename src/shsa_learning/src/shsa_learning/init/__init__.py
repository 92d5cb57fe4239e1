"""Drafts of a SOM and an ontology, from a survey of a robot."""

"""Drafts of a SOM and an ontology: from a survey of a robot, or from a knowledge base."""

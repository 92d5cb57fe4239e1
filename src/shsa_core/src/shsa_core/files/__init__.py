"""Ontology, SOM and settings in files and parameters: read strictly, written again."""

"""Ontology, SOM and settings as they stand in files and parameters: read strictly, written
again.
"""

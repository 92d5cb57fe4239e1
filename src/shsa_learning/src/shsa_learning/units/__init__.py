"""The units of properties, and how the laws of an ontology fit them."""

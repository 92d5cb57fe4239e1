"""The shells of fault injection: what acts on processes, nodes and the master."""

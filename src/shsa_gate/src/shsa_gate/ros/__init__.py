"""The gate's shell: the node `gate`."""

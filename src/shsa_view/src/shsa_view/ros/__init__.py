"""The shell: hears the tables of healing, and serves the page."""

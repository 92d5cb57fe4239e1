"""The substitute's three strings: written, checked anew, run."""

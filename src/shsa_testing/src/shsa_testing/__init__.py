"""Support for tests and benchmarks of self-healing."""

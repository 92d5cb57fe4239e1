"""The commands of `shsa` that this package brings."""

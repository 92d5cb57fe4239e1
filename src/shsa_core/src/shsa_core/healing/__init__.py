"""The reconfigurator's core: decides about failures."""

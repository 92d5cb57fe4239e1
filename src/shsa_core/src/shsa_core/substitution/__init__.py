"""How a substitute computes, and when it publishes."""

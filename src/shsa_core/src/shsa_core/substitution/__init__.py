"""The substitute: what it computes, when it publishes and to whom, and when it is muted."""

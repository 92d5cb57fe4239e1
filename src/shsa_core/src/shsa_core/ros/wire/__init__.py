"""Names of topics and services, and converters between messages and events."""

"""Messages: their fields, and the tables that are sent as changes."""

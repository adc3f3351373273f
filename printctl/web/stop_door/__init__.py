"""The stop's own way to the printer: a small process beside the server."""

"""General routes of the REST API: health, event stream, control lock, stop."""

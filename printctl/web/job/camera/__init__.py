"""Camera at the printer: a live picture about once a second, and a time-lapse per print."""

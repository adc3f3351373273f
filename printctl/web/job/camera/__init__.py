"""The camera at the printer: a picture about once a second, a time-lapse of each print."""

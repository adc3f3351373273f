"""Access control of the web server: guard middleware, sessions, log-in, uploads."""

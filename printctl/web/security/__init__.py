"""Who may ask for what: the guard at the door, sessions, log-in, uploads."""

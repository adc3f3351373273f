"""Access control: the guard at the door, sessions, log-in, uploads."""

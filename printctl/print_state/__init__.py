"""State of a print and its allowed actions, shared by page, API, command line and history."""

"""A print's state and what may be done next: one value for page, API, command line and history."""

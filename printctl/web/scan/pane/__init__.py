"""The Scan page's parts: slices, registration, what came of it."""

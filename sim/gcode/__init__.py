"""Read, time and dry-run G-code, and predict what it deposits."""

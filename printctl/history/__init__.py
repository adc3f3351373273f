"""Past prints: records, and comparisons of runs."""

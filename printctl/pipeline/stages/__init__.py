"""One file per stage: what it depends on, what it reads, its work."""

"""History page of the web interface: past prints, their records, and repeats."""

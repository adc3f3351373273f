"""Judge `printctl register` on scans of two generators that share no code with it."""

"""Linear systems of any graph: branches folded away, what loops leave factorised."""

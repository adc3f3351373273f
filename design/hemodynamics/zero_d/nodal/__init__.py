"""Linear systems of any graph, real or complex: branches folded away, what loops leave factorised."""

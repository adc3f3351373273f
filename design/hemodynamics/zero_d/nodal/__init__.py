"""Direct solver of network equations on any graph: trees folded, loops factorised."""

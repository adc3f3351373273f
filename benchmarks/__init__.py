"""Speed and accuracy against peers and limits."""

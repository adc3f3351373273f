"""Simulated controller board, whatever its firmware: parts that every family's twin is made of."""

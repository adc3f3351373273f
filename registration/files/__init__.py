"""Scan readers, and writers of scans and results."""

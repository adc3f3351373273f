"""Scan readers, and writers of scans and results.

Goes in: files. Comes out: `Scan`, and files for others. Begin with `readers/read.py`.
"""

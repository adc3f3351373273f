"""Prints that are over, and the evidence that belongs to them.

Goes in: journals. Comes out: entries and files. Begin with `past_print.py`.
"""

"""Readers of OCT makers' own formats, one a file.

Goes in: a scan file. Comes out: a `Scan`. Begin with `thorlabs.py`.
"""

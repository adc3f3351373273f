"""A G-code program as a table: words, modal state, findings, and the commands as written.

Goes in: a G-code file's text. Comes out: a `Program`. Begin with `gcode.py`.
"""

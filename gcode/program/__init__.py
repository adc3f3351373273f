"""Parse a G-code file into a table of commands with modal state; record of problems found.

Goes in: a G-code file's text. Comes out: a `Program`. Begin with `gcode.py`.
"""

"""Checks of a job before it may reach a printer.

Goes in: G-code, profiles, a design. Comes out: refusals, warnings, predictions. Begin with
`preflight/gcode.py`.
"""

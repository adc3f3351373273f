"""A machine that waits for a print: state, moves by hand, heat.

Goes in: commands. Comes out: a known state. Begin with `standby.py`.
"""

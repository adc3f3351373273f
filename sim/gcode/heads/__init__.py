"""Print heads as a G-code file uses them: selection, tip positions, valves of pneumatic heads.

Goes in: a program. Comes out: the head in use, tip positions and open valves, row by row. Begin
with `state.py`.
"""

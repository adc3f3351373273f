"""Join arterial and venous trees to closed loops: match terminals, route, fit curves.

Goes in: an arterial and a venous tree. Comes out: one network of closed loops. Begin with
`loops.py`.
"""

"""Join trees to closed loops: match terminals, find routes, fit curves.

Goes in: an arterial and a venous tree. Comes out: one network of closed loops. Begin with
`loops.py`.
"""

"""Solve lumped (0D) flow in networks, steady or pulsatile.

Goes in: a network and boundary conditions. Comes out: pressure at nodes, flow of vessels. Begin
with `steady.py`.
"""

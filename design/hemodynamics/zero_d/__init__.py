"""Lumped (0D) flow: steady, pulsatile (`pulsatile`), svZeroDSolver's files (`svzerod`).

Goes in: a network and boundary conditions. Comes out: pressure at nodes, flow of vessels. Begin
with `steady.py`.
"""

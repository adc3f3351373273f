"""Lumped (0D) flow: steady, pulsatile (`pulsatile`), svZeroDSolver's files (`svzerod`)."""

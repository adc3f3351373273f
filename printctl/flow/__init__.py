"""Pulsatile flow as the user asks for it, and the files it leaves."""

from printctl.flow.conditions import pulsatile_conditions
from printctl.flow.outputs import PULSES, WAVES, read_waves, solve_and_write

__all__ = ["PULSES", "WAVES", "pulsatile_conditions", "read_waves", "solve_and_write"]

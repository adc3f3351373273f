"""Flow as the user asks for it, and the files it leaves."""

from printctl.flow.conditions import pulsatile_conditions, steady_conditions
from printctl.flow.outputs import PULSES, WAVES, read_waves, solve_and_write
from printctl.flow.steady import TABLE, solve_steady

__all__ = [
    "PULSES",
    "TABLE",
    "WAVES",
    "pulsatile_conditions",
    "read_waves",
    "solve_and_write",
    "solve_steady",
    "steady_conditions",
]

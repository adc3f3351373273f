"""Solve periodic pulsatile 0D flow in a network, or in its electrical-analogue circuit.

Goes in: a network and pulsatile conditions. Comes out: the periodic state. Begin with
`solution.py`.
"""

from design.hemodynamics.zero_d.pulsatile.circuit import Circuit
from design.hemodynamics.zero_d.pulsatile.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.hemodynamics.zero_d.pulsatile.phasors import Phasors, solve_periodic
from design.hemodynamics.zero_d.pulsatile.solution import PulsatileSolution, solve_pulsatile
from design.hemodynamics.zero_d.pulsatile.summary import end_waves, pulsatile_summary
from design.hemodynamics.zero_d.pulsatile.table import pulsatile_table

__all__ = [
    "Circuit",
    "Outlet",
    "Phasors",
    "PressureOutlet",
    "PulsatileConditions",
    "PulsatileSolution",
    "ResistanceOutlet",
    "WindkesselOutlet",
    "end_waves",
    "pulsatile_summary",
    "pulsatile_table",
    "solve_periodic",
    "solve_pulsatile",
]

"""Data class of a case read from an svZeroDSolver file: vessel names, circuit, time steps."""

from __future__ import annotations

from dataclasses import dataclass

from design.hemodynamics.zero_d.pulsatile.circuit import Circuit
from design.hemodynamics.zero_d.pulsatile.march import MarchOptions


@dataclass(frozen=True)
class SvZeroDCase:
    """What the file says, in its own (consistent) units.

    Attributes
    ----------
    names : tuple of str
        Of the vessels, the circuit's first branches.
    circuit : Circuit
    options : MarchOptions
        Steps of a cycle, cycles, and the solver's spectral radius; its cycles are all gone
        through.
    """

    names: tuple[str, ...]
    circuit: Circuit
    options: MarchOptions

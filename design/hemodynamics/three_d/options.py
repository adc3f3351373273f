"""Options of the 3D flow solver: element order, convection, density, tolerance, memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from design.errors import FlowError
from design.hemodynamics.three_d.engine import THREADS
from design.units import WATER_DENSITY

LAMINAR: Final = 2000.0
"""Reynolds number by the diameter above which steady flow in a lumen may not be laminar."""


@dataclass(frozen=True)
class FlowOptions:
    """Options of the 3D flow solver.

    Attributes
    ----------
    order : int
        Of velocity: 2 or 3; pressure has one less.
    convection : bool
        Navier–Stokes, or Stokes flow, without inertia of turning and of narrowing.
    density : float, Pa·s²/mm²
        Of steady flow; pulsatile conditions have their own.
    tolerance : float
        Residual left, of that of no flow.
    threads : int
    memory_gb : float, optional
        Refused above it; without it, above what the machine has free.
    """

    order: int = 3
    convection: bool = True
    density: float = WATER_DENSITY
    tolerance: float = 1e-8
    threads: int = THREADS
    memory_gb: float | None = None

    def __post_init__(self) -> None:
        if self.order not in (2, 3):
            raise FlowError(f"elements of order {self.order}; take 2 or 3")
        if not 1e-12 <= self.tolerance <= 1e-3:
            raise FlowError(f"tolerance {self.tolerance:g} isn't between 1e-12 and 1e-3")

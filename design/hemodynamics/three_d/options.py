"""Options of the 3D flow solver: element order, convection, density, tolerance, memory."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from design.errors import FlowError
from design.hemodynamics.three_d.engine import THREADS
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
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


# Estimate the memory of a 3D flow solution; refuse one too large for the computer.

_BYTES = {2: 5500.0, 3: 7000.0}
"""By unknown: a third more than was measured on pipes and on networks of 170,000 unknowns."""
_GENERAL_BYTES = 15000.0
_BASE = 200e6


def unknowns(mesh: LumenMesh, order: int) -> int:
    """Number of velocity and pressure unknowns."""
    corners, edges, tets = mesh.corner_count, len(mesh.points) - mesh.corner_count, len(mesh.tets)
    triangles = (4 * tets + len(mesh.faces)) // 2
    if order == 2:
        return 3 * (corners + edges) + corners
    return 3 * (corners + 2 * edges + triangles) + corners + edges


def needed_bytes(mesh: LumenMesh, order: int) -> float:
    """Most that a solution takes."""
    return _BASE + _BYTES[order] * unknowns(mesh, order)


def free_bytes() -> float | None:
    """What the machine has left; None where it doesn't say."""
    lines = Path("/proc/meminfo")
    if lines.exists():
        held = [x for x in lines.read_text().splitlines() if x.startswith("MemAvailable:")]
        if held:
            return float(held[0].split()[1]) * 1024.0
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return None


def fits_general(count: int) -> bool:
    """Whether the machine has room for a factor of a matrix that isn't symmetric."""
    free = free_bytes()
    return free is None or _GENERAL_BYTES * count < free


def check_memory(mesh: LumenMesh, options: FlowOptions, share: float = 1.0) -> None:
    """Refuse what won't fit; ``share`` is 2 where numbers are complex.

    Raises
    ------
    FlowError
        With the numbers.
    """
    needed = share * needed_bytes(mesh, options.order)
    limit = free_bytes() if options.memory_gb is None else options.memory_gb * 1e9
    if limit is not None and needed > limit:
        whose = "free here" if options.memory_gb is None else "allowed (memory_gb)"
        raise FlowError(
            f"3D flow on {len(mesh.tets):,} elements of order {options.order} has "
            f"{unknowns(mesh, options.order):,} unknowns and takes some {needed / 1e9:.1f} GB, "
            f"above the {limit / 1e9:.1f} GB {whose}; take order 2, a coarser mesh, a part of the "
            "network, or MPI ranks"
        )

"""Build tube solids: a network's vessels with a wall of given thickness, lumens open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from design.errors import SolidError
from design.network import VesselNetwork
from design.solids.lumen import lumen_solid
from design.solids.manifolds import solid_manifold, subtract
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid
from design.solids.tube import FACET_TOLERANCE_MM, free_ends
from kernels.arrays import IntArray


def tube_solid(
    network: VesselNetwork,
    wall_mm: float,
    *,
    open_nodes: IntArray | None = None,
    tolerance_mm: float = FACET_TOLERANCE_MM,
    fillet_ratio: float = 0.0,
    fillet_mm: float | None = None,
) -> Solid:
    """The union of all vessels widened by ``wall_mm``, minus their lumens.

    Parameters
    ----------
    network : VesselNetwork
        Its radii are the lumens'.
    wall_mm : float, mm
    open_nodes : (k,) int64, optional
        Free ends that are open, cut square at the node; all of them by default. The others
        are closed by a wall of the same thickness.
    tolerance_mm, fillet_ratio, fillet_mm
        As `lumen_solid` has them, for the lumen and the outside alike.

    Returns
    -------
    Solid
        Of genus (loops of the outside) + (loops of the lumens) + (open ends) - (parts with any)
        where vessels that aren't joined keep clear of one another by two walls.

    Raises
    ------
    SolidError
        When ``wall_mm`` isn't above 0, or as `lumen_solid` does.
    """
    ends = free_ends(network) if open_nodes is None else np.asarray(open_nodes, dtype=np.int64)
    beyond = 4.0 * float(network.radius.max()) if len(ends) else 0.0
    outer = tube_outside(
        network,
        wall_mm,
        open_nodes=ends,
        tolerance_mm=tolerance_mm,
        fillet_ratio=fillet_ratio,
        fillet_mm=fillet_mm,
    )
    inner = lumen_solid(
        network,
        extend_ends_mm=beyond,
        extend_nodes=ends,
        tolerance_mm=tolerance_mm,
        fillet_ratio=fillet_ratio,
        fillet_mm=fillet_mm,
    )
    wall = subtract(solid_manifold(outer, "the outside"), [solid_manifold(inner, "the lumens")])
    return solid_from_manifold(wall, "the tubes")


def tube_outside(
    network: VesselNetwork,
    wall_mm: float,
    *,
    open_nodes: IntArray | None = None,
    tolerance_mm: float = FACET_TOLERANCE_MM,
    fillet_ratio: float = 0.0,
    fillet_mm: float | None = None,
) -> Solid:
    """`tube_solid` before its lumens are taken out; parameters and errors are the same."""
    if not 0.0 < wall_mm < np.inf:
        raise SolidError(f"wall_mm {wall_mm:g}; give a thickness above 0")
    ends = free_ends(network) if open_nodes is None else np.asarray(open_nodes, dtype=np.int64)
    # A hundredth of the wall, so that the end's face is flat and no seam lies on the node's plane.
    return lumen_solid(
        replace(network, radius=network.radius + wall_mm),
        extend_ends_mm=0.01 * wall_mm if len(ends) else 0.0,
        extend_nodes=ends,
        tolerance_mm=tolerance_mm,
        fillet_ratio=fillet_ratio,
        fillet_mm=fillet_mm,
    )

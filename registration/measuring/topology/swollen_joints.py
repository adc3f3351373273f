"""Distinguish a junction printed too wide at its fork from a bridge between the vessels.

Two vessels that meet at a node are one lumen there. Liquid between them is a bridge only where it
goes round gel; where it doesn't, the joint itself reaches farther out than designed, as
overlapping beads make it. Which of the two it is the Betti number of loops says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray
from registration.alignment import Fit
from registration.measuring.topology.euler import betti_numbers, without_specks
from registration.measuring.topology.gel_paths import OUTSIDE, LeakPath
from registration.measuring.topology.grid import LumenGrid, lay_grid
from registration.segmentation import GelField

_ROUND = 1.25
"""Loops are looked for in a ball about the node, so much larger than the way's farthest place."""
_NEAR_MM = 0.3
"""What is free so near to the way belongs to it."""
_RESOLVED = 1.5
"""Voxels of the scan from liquid that a place on a way may lie: gel between would be seen."""
_SPECK = 8
"""Voxels; fewer that hang together are noise."""


@dataclass(frozen=True)
class SwollenJoint:
    """A joint that reaches into designed gel.

    Attributes
    ----------
    node : int
        In the network.
    out_mm : float, mm
        How far it reaches beyond the designed wall, seen from the node.
    tip_mm : (3,) float64, mm
        Where it reaches farthest, part frame.
    """

    node: int
    out_mm: float
    tip_mm: FloatArray


def swelling(
    way: LeakPath, network: VesselNetwork, field: GelField, fit: Fit, clear_mm: float
) -> SwollenJoint | None:
    """Return the swelling of a joint that a way is part of.

    None where the way goes round gel, and where the scan doesn't resolve it as liquid.

    Parameters
    ----------
    way : LeakPath
    network : VesselNetwork
        The design.
    field : GelField
        The scan's gel.
    fit : Fit
        Scan to part.
    clear_mm : float, mm
        What is free nearer to a designed wall is no swelling.
    """
    first, second = way.ends
    if second == OUTSIDE:
        return None
    for node in np.intersect1d(network.vessel_nodes[first], network.vessel_nodes[second]):
        middle = network.nodes[node]
        reach = _ROUND * float(np.linalg.norm(way.path - middle, axis=1).max())
        voxel = float(field.voxel_mm.max())
        bounds = np.stack([middle - reach, middle + reach])
        # Finer than the whole part's grid, whose voxels may be as wide as a way.
        grid = lay_grid(network, field, fit, bounds, float(field.voxel_mm.min()) / 2, reach)
        joint = _about(int(node), middle, way.path, grid, (clear_mm, voxel, reach))
        if joint is not None:
            return joint
    return None


def _about(
    node: int,
    middle: FloatArray,
    path: FloatArray,
    grid: LumenGrid,
    sizes: tuple[float, float, float],
) -> SwollenJoint | None:
    """Swelling about a node at `middle`; `sizes`: wall's rim, scan's voxel, ball's radius, mm."""
    clear, voxel, ball = sizes
    places = grid.places(np.argwhere(np.ones(grid.free.shape, dtype=np.bool_)))
    away = np.linalg.norm(places - middle, axis=1).reshape(grid.free.shape)
    lumen = (grid.wall_mm <= 0) | (grid.free & grid.known)
    lumen = _connected(without_specks(lumen, _SPECK) & (away <= ball), away)
    open_ = places[lumen.ravel()]
    apart = np.array([np.linalg.norm(open_ - place, axis=1).min() for place in path])
    if apart.max() > _RESOLVED * voxel or betti_numbers(lumen).loops:
        return None
    free = places[(lumen & (grid.wall_mm > clear)).ravel()]
    near = np.array([np.linalg.norm(path - p, axis=1).min() <= _NEAR_MM for p in free], dtype=bool)
    # Where nothing is free so far from the walls, the way itself is all there is of it.
    return _farthest(node, middle, free[near] if near.any() else path, grid)


def _connected(lumen: BoolArray, away: FloatArray) -> BoolArray:
    """What hangs together with the place nearest to the node."""
    label, _ = ndimage.label(lumen)
    return np.asarray(lumen & (label == label.ravel()[int(np.argmin(away))]))


def _farthest(node: int, middle: FloatArray, swollen: FloatArray, grid: LumenGrid) -> SwollenJoint:
    """Find the place of (n, 3), mm, before which the most designed gel lies, from the node."""
    reach = np.linalg.norm(swollen - middle, axis=1)
    share = np.linspace(0.0, 1.0, int(np.ceil(2 * reach.max() / grid.step_mm)) + 1)
    places = middle + share[:, None, None] * (swollen - middle)
    index = np.round((places - grid.origin_mm) / grid.step_mm).astype(np.int64)[..., ::-1]
    gel = grid.wall_mm[tuple(np.moveaxis(index, -1, 0))] > 0
    out = gel.mean(axis=0) * reach
    worst = int(np.argmax(out))
    return SwollenJoint(node, float(out[worst]), swollen[worst])

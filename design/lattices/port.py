"""Find a straight channel from a lattice's side out of the tissue, as its inlet or outlet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry import segment_segment
from design.tissue import Tissue
from kernels.arrays import FloatArray, IntArray


def find_port(
    tissue: Tissue,
    nodes: FloatArray,
    bonds: IntArray,
    radius: FloatArray,
    port_radius: float,
    clearance: float,
    axis: int,
    side: int,
    layer: NDArray[np.bool_],
) -> tuple[int, FloatArray]:
    """The node of a layer nearest its middle from which a port leads out, and where it does.

    Parameters
    ----------
    nodes : (n, 3) float64, mm
    bonds : (m, 2) int64
    radius : (m,) float64, mm
        Of each bond.
    port_radius, clearance : float, mm
    axis : int
        Along which the port runs.
    side : int
        -1 for its lower end, 1 for the upper.
    layer : (n,) bool
        Where it may begin.

    Raises
    ------
    TissueError
        When none does without meeting other channels or more tissue.
    """
    candidates = np.flatnonzero(layer)
    across = np.delete(nodes[candidates], axis, axis=1)
    away = np.linalg.norm(across - across.mean(axis=0), axis=1)
    # Of those above one another the outermost; rounded, since their distances differ by rounding.
    order = np.lexsort((-side * nodes[candidates, axis], np.round(away, 9)))
    for node in candidates[order]:
        end = _way_out(tissue, nodes[node], axis, side)
        if end is not None and _is_free(
            int(node), end, nodes, bonds, radius + port_radius + clearance
        ):
            return int(node), end
    raise TissueError(
        f"none of the {len(candidates)} nodes at the {'lower' if side < 0 else 'upper'} end along "
        f"{'xyz'[axis]} has a straight way out for a port {2.0 * port_radius:g} mm wide; choose "
        "another axis, or narrower manifolds"
    )


def _way_out(tissue: Tissue, start: FloatArray, axis: int, side: int) -> FloatArray | None:
    """Where a line from ``start`` leaves the tissue for good; None when it meets tissue again."""
    step = 0.25 * tissue.grid.spacing_mm
    far = tissue.bounds[(side + 1) // 2, axis] + side * 4.0 * step
    line = np.repeat(start[None], max(2, int(abs(far - start[axis]) / step) + 2), axis=0)
    line[:, axis] = np.linspace(start[axis], far, len(line))
    inside = tissue.contains(line)
    leaves = int(np.argmin(inside))
    if inside[leaves:].any():
        return None
    within, beyond = line[leaves - 1], line[leaves]
    depth = tissue.grid.distance(np.stack([within, beyond]))
    out: FloatArray = within + (beyond - within) * (depth[0] / (depth[0] - depth[1]))
    return out


def _is_free(
    node: int, end: FloatArray, nodes: FloatArray, bonds: IntArray, need: FloatArray
) -> bool:
    """Whether the way from ``node`` to ``end`` keeps ``need`` (m,), mm, from other bonds' axes."""
    start = nodes[node]
    low, high = np.minimum(start, end) - need.max(), np.maximum(start, end) + need.max()
    both = nodes[bonds]
    near = ((both.min(axis=1) <= high) & (both.max(axis=1) >= low)).all(axis=1)
    near &= (bonds != node).all(axis=1)
    return all(
        segment_segment(*start, *end, *both[k, 0], *both[k, 1])[0] >= need[k]
        for k in np.flatnonzero(near)
    )

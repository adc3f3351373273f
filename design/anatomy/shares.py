"""Warn of the region of an organ that has under half of the terminals its volume calls for."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.graph_trunk import spread_sites
from design.tissue import Tissue
from design.vasculature.growth.territories import demand_points
from kernels.arrays import FloatArray

_POINTS = 12_000
_PLACES, _TERMINALS = 24, 40
"""Places compared at most, and terminals that each has at least on average."""

_FEW = 0.5


def uneven_notes(tissue: Tissue, ends: FloatArray, seed: int = 1) -> tuple[str, ...]:
    """A sentence on the place that gets least, where it gets under half of its share.

    Parameters
    ----------
    ends : (n, 3) float64, mm
        Where the terminals end.
    """
    places = min(_PLACES, len(ends) // _TERMINALS)
    if places < 2:
        return ()
    points, weight = demand_points(tissue, _POINTS, seed)
    # By their nearest place, moved to the middle once: parts of about the same size.
    middle = points[spread_sites(points, places, points[:0])]
    number = cKDTree(middle).query(points)[1]
    middle = np.array([points[number == n].mean(axis=0) for n in range(places)])
    index = cKDTree(middle)
    asked = np.bincount(index.query(points)[1], weight, places) / weight.sum() * len(ends)
    got = np.bincount(index.query(ends)[1], minlength=places)
    worst = int(np.argmin(got / asked))
    if got[worst] >= _FEW * asked[worst]:
        return ()
    x, y, z = middle[worst].tolist()
    return (
        f"the tissue around ({x:.3g}, {y:.3g}, {z:.3g}) mm gets {got[worst]} terminals where its "
        f"volume asks for {asked[worst]:.0f}: trunks are far from it; more trunk_ends or a higher "
        "pressure_drop_mmhg may help",
    )

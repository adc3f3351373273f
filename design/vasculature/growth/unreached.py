"""Find large places of a tissue that no terminal is near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from design.tissue import Tissue
from design.vasculature.growth.territories import demand_points

FloatArray = NDArray[np.float64]

FAR = 3.0
"""Distance from the nearest terminal, over the typical one, from which on a place is far."""

TYPICAL = 25.0
"""Percentile of the distances by demand that is taken for typical: most of a tissue may be far."""

LEAST_TERMINALS = 6.0
"""Terminals' worth of demand that a far place must ask for."""

_PER_TERMINAL, _AT_LEAST, _AT_MOST = 40, 4_000, 100_000
_SEED = 5


@dataclass(frozen=True)
class Unreached:
    """A place that no terminal is near.

    Attributes
    ----------
    volume_mm3 : float
    middle_mm : (float, float, float)
        The point of it that is farthest from any terminal.
    points : (n, 3) float64, mm
        That fill it evenly.
    share : float
        Of the tissue's demand.
    """

    volume_mm3: float
    middle_mm: tuple[float, float, float]
    points: FloatArray
    share: float

    def __str__(self) -> str:
        """Size and place, for messages."""
        x, y, z = self.middle_mm
        return f"the {self.volume_mm3:.3g} mm³ around ({x:.4g}, {y:.4g}, {z:.4g}) mm"


def unreached(tissue: Tissue, ends: FloatArray) -> tuple[Unreached, ...]:
    """Connected places far from all terminals that ask for several terminals, largest first.

    A tree covers what its vessels fit into; a lobe behind a neck narrower than they are is left
    out although it hangs together with the rest.

    Parameters
    ----------
    tissue : Tissue
    ends : (n, 3) float64, mm
        Where the terminals end.
    """
    if len(ends) < 2 * LEAST_TERMINALS:
        return ()
    count = int(np.clip(_PER_TERMINAL * len(ends), _AT_LEAST, _AT_MOST))
    points, weight = demand_points(tissue, count, _SEED)
    asks = weight / weight.sum() * len(ends)
    away, _ = KDTree(ends).query(points)
    order = np.argsort(away)
    below = np.cumsum(asks[order]) / len(ends)
    typical = float(away[order][np.searchsorted(below, TYPICAL / 100.0)])
    far = away > FAR * typical
    if asks[far].sum() < LEAST_TERMINALS:
        return ()
    points, away, asks = points[far], away[far], asks[far]
    reach = 2.5 * float(np.cbrt(tissue.volume_mm3 / count))
    pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points),) * 2)
    group = connected_components(graph, directed=False)[1]
    found = []
    for n in np.flatnonzero(np.bincount(group, weights=asks) >= LEAST_TERMINALS):
        own = np.flatnonzero(group == n)
        x, y, z = points[own[np.argmax(away[own])]].tolist()
        volume, share = tissue.volume_mm3 * len(own) / count, float(asks[own].sum() / len(ends))
        found.append(Unreached(volume, (x, y, z), points[own], share))
    return tuple(sorted(found, key=lambda one: -one.volume_mm3))

"""Find large connected volumes of a tissue that are far from every terminal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from design.tissue import Tissue
from design.vasculature.growth.territories import demand_points
from kernels.arrays import FloatArray

FAR = 3.0
"""Distance from the nearest terminal, over the typical one, from which on a place is far; both
times the cube root of the demand there."""

TYPICAL = 25.0
"""Percentile of the distances by demand that is taken for typical: most of a tissue may be far."""

LEAST_TERMINALS = 6.0
"""Terminals' worth of demand that a far place must ask for."""

LEAST_PROBES = 12
"""Probes that it must have: in trees of above 50,000 terminals a single one asks for several, and
may lie in or beside a wide vessel."""

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
    members : (n,) int64
        Its points among the probes.
    """

    volume_mm3: float
    middle_mm: tuple[float, float, float]
    members: NDArray[np.int64]

    def __str__(self) -> str:
        """Size and place, for messages."""
        x, y, z = self.middle_mm
        return f"the {self.volume_mm3:.3g} mm³ around ({x:.4g}, {y:.4g}, {z:.4g}) mm"


@dataclass(frozen=True)
class Probes:
    """Points that fill a tissue evenly.

    Attributes
    ----------
    points : (n, 3) float64, mm
    asks : (n,) float64
        Share of the tissue's demand; their sum is 1.
    reach_mm : float
        Distance within which two points count as neighbours.
    """

    points: FloatArray
    asks: FloatArray
    reach_mm: float


def probes_for(tissue: Tissue, terminals: int) -> Probes:
    """Points that suit so many terminals; same arguments, same points."""
    count = int(np.clip(_PER_TERMINAL * terminals, _AT_LEAST, _AT_MOST))
    points, weight = demand_points(tissue, count, _SEED)
    reach = 2.5 * float(np.cbrt(tissue.volume_mm3 / count))
    return Probes(points, weight / weight.sum(), reach)


def unreached(
    tissue: Tissue, ends: FloatArray, probes: Probes | None = None
) -> tuple[Unreached, ...]:
    """Connected places far from all terminals that ask for several terminals, largest first.

    A tree covers what its vessels fit into; a lobe behind a neck narrower than they are is left
    out although it hangs together with the rest.

    Parameters
    ----------
    tissue : Tissue
    ends : (n, 3) float64, mm
        Where the terminals end.
    probes : Probes, optional
    """
    if len(ends) < 2 * LEAST_TERMINALS:
        return ()
    probes = probes or probes_for(tissue, len(ends))
    asks = probes.asks * len(ends)
    away, _ = KDTree(ends).query(probes.points)
    # Where less is asked for, terminals lie farther apart by the cube root of it.
    away = away * np.cbrt(probes.asks * len(probes.asks))
    order = np.argsort(away)
    below = np.cumsum(probes.asks[order])
    typical = float(away[order][np.searchsorted(below, TYPICAL / 100.0)])
    far = np.flatnonzero(away > FAR * typical)
    if asks[far].sum() < LEAST_TERMINALS:
        return ()
    pairs = KDTree(probes.points[far]).query_pairs(probes.reach_mm, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(far),) * 2)
    group = connected_components(graph, directed=False)[1]
    places = []
    large = np.bincount(group, weights=asks[far]) >= LEAST_TERMINALS
    for n in np.flatnonzero(large & (np.bincount(group) >= LEAST_PROBES)):
        own = far[group == n]
        x, y, z = probes.points[own[np.argmax(away[own])]].tolist()
        volume = tissue.volume_mm3 * len(own) / len(away)
        places.append(Unreached(volume, (x, y, z), own))
    return tuple(sorted(places, key=lambda one: -one.volume_mm3))

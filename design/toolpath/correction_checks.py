"""Refuse compensated lumens that leave walls between them, or to the outside, too thin.

A design may be tighter somewhere than the method likes: it was accepted as it is. Refused is what
a correction makes too thin.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.vasculature.collide import check_network, collisions
from kernels.arrays import FloatArray

SLACK_MM = 1e-3
"""Walls thinner by no more than this are as they were."""
_PLACES = 8
"""At which each straight piece's distance to the outside is asked for."""


class Body(Protocol):
    """What the vessels lie in."""

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance of places (n, 3) to its surface, (n,), mm; negative inside."""


def check_walls(before: VesselNetwork, after: VesselNetwork, wall_mm: float) -> None:
    """Refuse vessels that touch, or whose wall became thinner than ``wall_mm``.

    Raises
    ------
    NetworkError
        When vessels overlap that didn't.
    ToolpathError
        With the two vessels, the wall and the limit.
    """
    was, now = collisions(before, wall_mm), collisions(after, wall_mm)
    if not was.count or float(was.gap_mm.min()) >= 0:
        check_network(after)
    had = {(int(a), int(b)): float(g) for (a, b), g in zip(was.pieces, was.gap_mm, strict=True)}
    pieces = zip(now.pieces.tolist(), now.vessels.tolist(), now.gap_mm.tolist(), strict=True)
    for (a, b), (one, two), gap in pieces:
        if gap < min(had.get((a, b), wall_mm), wall_mm) - SLACK_MM:
            raise ToolpathError(
                f"vessels {one} and {two}: the compensation would leave {1e3 * gap:.0f} um of wall "
                f"between them, limit {1e3 * wall_mm:.0f} um (a line, or the needle's room); leave "
                "one of them out (compensate --without-vessel) or move them apart in the design"
            )


def check_outside(before: VesselNetwork, after: VesselNetwork, body: Body, wall_mm: float) -> None:
    """Refuse lumens that came nearer to the body's surface than ``wall_mm``.

    Places that were nearer by design may stay as near as they were; around free ends, where
    lumens open through the surface, nothing is asked.

    Raises
    ------
    ToolpathError
        With the vessel, the wall and the limit.
    """
    had, has = _depths(before, body), _depths(after, body)
    asked = ~_at_ends(before, wall_mm) & (had > 0)
    thin = np.flatnonzero(asked & (has < np.minimum(had, wall_mm) - SLACK_MM))
    if len(thin) == 0:
        return
    worst = int(thin[np.argmin(has[thin])])
    vessel = int(before.pieces()[4][worst // _PLACES])
    raise ToolpathError(
        f"vessel {vessel}: the compensation would leave {1e3 * has[worst]:.0f} um between it and "
        f"the outside, limit {1e3 * wall_mm:.0f} um (it has {1e3 * had[worst]:.0f} by design); "
        f"leave it out (compensate --without-vessel {vessel}) or make the body larger"
    )


def _places(network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
    """Places along every piece (n, 3), and the radii there (n,), mm."""
    start, end, r0, r1, _ = network.pieces()
    share = ((np.arange(_PLACES) + 0.5) / _PLACES)[None, :]
    places = start[:, None] * (1 - share[..., None]) + end[:, None] * share[..., None]
    radius = r0[:, None] * (1 - share) + r1[:, None] * share
    return places.reshape(-1, 3), radius.reshape(-1)


def _depths(network: VesselNetwork, body: Body) -> FloatArray:
    """Wall to the body's surface at places along every piece, (n,), mm."""
    places, radius = _places(network)
    return np.asarray(-body.distance(places) - radius)


def _at_ends(network: VesselNetwork, wall_mm: float) -> NDArray[np.bool_]:
    """Whether the surface near each place may be the one that a free end opens."""
    ends = network.nodes[network.degree() == 1]
    places, radius = _places(network)
    if len(ends) == 0:
        return np.zeros(len(places), dtype=np.bool_)
    away, _ = cKDTree(ends).query(places)
    return np.asarray(away < 1.5 * (radius + wall_mm))

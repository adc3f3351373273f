"""The open space of a network's vessels as one solid."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.network import FloatArray, IntArray, VesselNetwork
from design.solids.chains import Chain
from design.solids.facets import FACET_TOLERANCE_MM, facet_count, inscribed_factor
from design.solids.manifolds import to_manifold, unite
from design.solids.runs import free_ends, split_runs
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid
from design.solids.tube import EndShape, tube_mesh

_CLEAR_OF_TUBES = 0.999
"""Balls stay this factor inside the tubes' facets, so that the union has no slivers."""

_COARSER_BALLS = 4.0
"""Balls show only in the outer corner of a bend: half the tubes' facets make half the time."""


def lumen_solid(
    network: VesselNetwork,
    *,
    extend_ends_mm: float = 0.0,
    extend_nodes: IntArray | None = None,
    tolerance_mm: float = FACET_TOLERANCE_MM,
) -> Solid:
    """Sharp union of all vessels: conical frusta, mitred at gentle bends, balls where they meet.

    The cross-section's area is that of the circle, so volume and conductance are those of the
    design. Free ends are closed by half balls, as capsules are, or extended straight and cut
    flat.

    Parameters
    ----------
    network : VesselNetwork
    extend_ends_mm : float, mm
        By how much free ends are drawn out, so that they pass cleanly through a construct's
        face; 0 leaves them round.
    extend_nodes : (k,) int64, optional
        The free ends that are extended (see `open_ends`); all of them by default.
    tolerance_mm : float, mm
        Greatest distance between facet and arc.

    Returns
    -------
    Solid
        Its genus is that of the network's graph (`network_genus`) unless vessels touch that
        aren't joined.

    Raises
    ------
    SolidError
        Negative extension, tolerance not above 0, vessel of zero length, or a union that can't
        be kept closed in float32.
    """
    if not (extend_ends_mm >= 0.0 and tolerance_mm > 0.0):
        raise SolidError(
            f"extend_ends_mm {extend_ends_mm:g} and tolerance_mm {tolerance_mm:g} mm: give a "
            "length of at least 0 and a tolerance above 0"
        )
    extended = _extended(network, extend_ends_mm, extend_nodes)
    runs, balls = split_runs(network, tolerance_mm)
    joined = network.degree() > 1
    parts = [_tube(run, joined, extended, extend_ends_mm, tolerance_mm) for run in runs]
    parts += [
        _ball(centre, radius, tolerance_mm)
        for centre, radius in zip(balls.centre, balls.radius.tolist(), strict=True)
    ]
    return solid_from_manifold(unite(parts), "the lumens' union")


def _extended(
    network: VesselNetwork, extend_ends_mm: float, extend_nodes: IntArray | None
) -> set[int]:
    if extend_ends_mm == 0.0:
        return set()
    free = set(free_ends(network).tolist())
    if extend_nodes is None:
        return free
    asked = set(np.asarray(extend_nodes).tolist())
    if not asked <= free:
        raise SolidError(
            f"extend_nodes: node {min(asked - free)} isn't a free end of the network; "
            f"choose from its {len(free)} free ends"
        )
    return asked


def _tube(
    run: Chain,
    joined: NDArray[np.bool_],
    extended: set[int],
    extend_ends_mm: float,
    tolerance_mm: float,
) -> Manifold:
    points, radius = run.points, run.radius
    shapes: list[EndShape] = []
    for node, at in zip(run.node[[0, -1]].tolist(), (0, -1), strict=True):
        shapes.append("flat" if node < 0 or joined[node] or node in extended else "round")
        if node in extended:
            points, radius = _drawn_out(points, radius, at, extend_ends_mm)
    facets = facet_count(float(radius.max()), tolerance_mm)
    vertices, faces = tube_mesh(points, radius, facets, (shapes[0], shapes[1]))
    return to_manifold(vertices, faces, "a vessel's tube")


def _drawn_out(
    points: FloatArray, radius: FloatArray, at: int, length_mm: float
) -> tuple[FloatArray, FloatArray]:
    """One more point beyond the first (``at`` 0) or last (-1), at the end's own radius."""
    inner = 1 if at == 0 else -2
    outward = points[at] - points[inner]
    tip = points[at] + outward * (length_mm / np.linalg.norm(outward))
    where = 0 if at == 0 else len(points)
    return np.insert(points, where, tip, axis=0), np.insert(radius, where, radius[at])


def _ball(centre: FloatArray, radius: float, tolerance_mm: float) -> Manifold:
    inscribed = inscribed_factor(facet_count(radius, tolerance_mm)) * _CLEAR_OF_TUBES
    facets = facet_count(radius, _COARSER_BALLS * tolerance_mm)
    return Manifold.sphere(radius * inscribed, facets).translate(centre.tolist())

"""Build the lumen solid of a network: the union of all vessels, junctions rounded."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from design.errors import SolidError
from design.network import FloatArray, IntArray, VesselNetwork
from design.solids.chains import Chain
from design.solids.facets import FACET_TOLERANCE_MM, Facets
from design.solids.runs import free_ends
from design.solids.smooth.assemble import sew_parts
from design.solids.smooth.layout import Layout, lay_out
from design.solids.snap import mended_solid, solid_from_mesh
from design.solids.solid import Solid
from design.solids.tube import EndShape

_TRIES = 3
"""Of leaving groups sharp that can't be rounded without crossing themselves."""


def lumen_solid(
    network: VesselNetwork,
    *,
    extend_ends_mm: float | FloatArray = 0.0,
    extend_nodes: IntArray | None = None,
    tolerance_mm: float = FACET_TOLERANCE_MM,
    facet_ratio: float = 0.0,
    fillet_ratio: float = 0.0,
    fillet_mm: float | None = None,
) -> Solid:
    """Union of all vessels: conical frusta, mitred at gentle bends, balls where they meet.

    The cross-section's area is that of the circle, so volume and conductance are those of the
    design. Free ends are closed by half balls, as capsules are, or extended straight and cut
    flat. Junctions have sharp seams, or are rounded as by a ball rolled along them from outside.

    Parameters
    ----------
    network : VesselNetwork
    extend_ends_mm : float or (k,) float64, mm
        By how much free ends are drawn out, so that they pass cleanly through a construct's
        face; 0 leaves them round. One length, or one for each of ``extend_nodes``.
    extend_nodes : (k,) int64, optional
        The free ends that are extended (see `open_ends`); all of them by default.
    tolerance_mm : float, mm
        Greatest distance between facet and arc.
    facet_ratio : float
        That distance over the vessel's radius, where it is more than ``tolerance_mm``: large trees
        have vessels of many sizes, and triangles that nobody can open.
    fillet_ratio : float
        Radius of the fillet at a junction over that of its thinnest vessel: radii within a tree
        differ twentyfold, and so must its fillets. 0, the default, leaves seams sharp; 0.5 is
        round. Where neighbouring junctions leave no room it is reduced, by steps to a tenth and
        then to none; within a group around each place that has none.
    fillet_mm : float, mm, optional
        The same radius at all junctions, in the place of ``fillet_ratio``.

    Returns
    -------
    Solid
        Its genus is that of the network's graph (`network_genus`) unless vessels touch that
        aren't joined.

    Raises
    ------
    SolidError
        Negative extension or fillet, tolerance not above 0, vessel of zero length, or a union
        that can't be kept closed in float32.
    """
    _check(extend_ends_mm, tolerance_mm, fillet_ratio if fillet_mm is None else fillet_mm)
    extended = extended_ends(network, extend_ends_mm, extend_nodes)
    # Around the middle of the network, so that far from the origin no digits are lost in between.
    middle = np.round(0.5 * (network.points.min(axis=0) + network.points.max(axis=0)))
    moved, sharp = network.moved(-middle), set[int]()
    for _ in range(_TRIES):
        layout = lay_out(moved, Facets(tolerance_mm, facet_ratio), fillet_ratio, fillet_mm)
        layout.sharp |= sharp
        solid = _made(layout, extended, middle)
        if not _united(layout):
            return solid
        solid, crossing = mended_solid(solid, tolerance_mm)
        crowded = [joint for joint in range(len(layout.ends)) if layout.crowded(joint)]
        if len(crossing) == 0 or not crowded or not (fillet_ratio > 0.0 or fillet_mm):
            return solid
        # Groups that cross themselves once they are rounded to float32 stay sharp.
        places = solid.vertices[solid.faces[crossing, 0]] - middle
        centres = np.array([layout.walls[joint][0, :3] for joint in crowded])
        near = cKDTree(centres).query(places)[1]
        sharp |= {crowded[index] for index in near.tolist()}
    return solid


def _made(
    layout: Layout,
    extended: dict[int, float],
    middle: FloatArray,
) -> Solid:
    """All parts sewn and rounded; where some were united, crossings may still be in it."""
    joined = layout.joint_of()
    shapes: list[tuple[EndShape, EndShape]] = []
    for index, run in enumerate(layout.runs):
        ends: list[EndShape] = []
        for end in (0, 1):
            node = int(run.node[-end])
            ends.append("flat" if (index, end) in joined or node in extended else "round")
        shapes.append((ends[0], ends[1]))
        layout.runs[index] = extend_ends(run, extended)
    vertices, faces = sew_parts(layout, shapes)
    mend = not _united(layout)
    return solid_from_mesh(vertices + middle, faces, "the lumens' union", mend=mend)


def _united(layout: Layout) -> bool:
    """Whether any part is a union of several; known once all is sewn."""
    crowded = any(layout.crowded(joint) for joint in range(len(layout.ends)))
    return crowded or any(layout.swallowed)


def _check(extend_ends_mm: float | FloatArray, tolerance_mm: float, fillet: float) -> None:
    if not (np.all(np.asarray(extend_ends_mm) >= 0.0) and tolerance_mm > 0.0):
        raise SolidError(
            f"extend_ends_mm {extend_ends_mm} and tolerance_mm {tolerance_mm:g} mm: give a "
            "length of at least 0 and a tolerance above 0"
        )
    if not 0.0 <= fillet < np.inf:
        raise SolidError(f"fillet {fillet:g}; give a radius of at least 0 (0: sharp seams)")


def extended_ends(
    network: VesselNetwork, extend_ends_mm: float | FloatArray, extend_nodes: IntArray | None
) -> dict[int, float]:
    """The free ends that `lumen_solid` draws out, checked, and by how much, mm."""
    if not np.any(extend_ends_mm):
        return {}
    free = free_ends(network)
    asked = free if extend_nodes is None else np.asarray(extend_nodes, dtype=np.int64)
    strange = np.setdiff1d(asked, free)
    if len(strange):
        raise SolidError(
            f"extend_nodes: node {strange[0]} isn't a free end of the network; "
            f"choose from its {len(free)} free ends"
        )
    lengths = np.asarray(extend_ends_mm, dtype=np.float64)
    if lengths.shape not in ((), asked.shape):
        raise SolidError(
            f"extend_ends_mm has {lengths.size} lengths for {len(asked)} ends; give one for each, "
            "or one for all"
        )
    every = np.broadcast_to(lengths, asked.shape)
    return {
        node: length
        for node, length in zip(asked.tolist(), every.tolist(), strict=True)
        if length > 0.0
    }


def extend_ends(run: Chain, extended: dict[int, float]) -> Chain:
    """The same run, longer at the nodes ``extended`` by the lengths given there, mm."""
    points, radius, node = run.points, run.radius, run.node
    for at in (0, -1):
        length = extended.get(int(run.node[at]))
        if length is not None:
            points, radius = _drawn_out(points, radius, at, length)
            node = np.insert(node, 0 if at == 0 else len(node), node[at])
    return Chain(points, radius, node)


def _drawn_out(
    points: FloatArray, radius: FloatArray, at: int, length_mm: float
) -> tuple[FloatArray, FloatArray]:
    """One more point beyond the first (``at`` 0) or last (-1), at the end's own radius."""
    inner = 1 if at == 0 else -2
    outward = points[at] - points[inner]
    tip = points[at] + outward * (length_mm / np.linalg.norm(outward))
    where = 0 if at == 0 else len(points)
    return np.insert(points, where, tip, axis=0), np.insert(radius, where, radius[at])

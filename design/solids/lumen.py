"""Build the lumen solid of a network: the union of all vessels, junctions rounded."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from design.errors import SolidError
from design.geometry.crossings import find_crossings
from design.network import VesselNetwork
from design.solids.manifolds import solid_manifold, subtract
from design.solids.smooth.assemble import sew_parts
from design.solids.smooth.layout import Layout, lay_out
from design.solids.smooth.sewing import Sewing, with_other_tubes
from design.solids.snap import mended_solid, solid_from_manifold, solid_from_mesh
from design.solids.solid import Solid
from design.solids.tube import FACET_TOLERANCE_MM, Chain, EndShape, Facets, free_ends
from kernels.arrays import FloatArray, IntArray

MAX_ATTEMPTS = 3
"""Of leaving groups sharp that can't be rounded without crossing themselves."""
DOME_RADII = 1.2
"""Radii beyond a free end that contain the half ball which closes it (`dome_profile`: 1.01)."""


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
        have vessels of many sizes, and triangles that no viewer can open.
    fillet_ratio : float
        Radius of the fillet at a junction over that of its thinnest vessel: radii within a tree
        differ twentyfold, and so must its fillets. 0, the default, leaves seams sharp; 0.5 is
        round. Where neighbouring junctions leave no space it is reduced, by steps to a tenth and
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
    middle, moved = _around_middle(network)
    rounds = fillet_ratio > 0.0 or bool(fillet_mm)
    sharp = set[int]()
    for _ in range(MAX_ATTEMPTS if rounds else 1):
        layout = lay_out(moved, Facets(tolerance_mm, facet_ratio), fillet_ratio, fillet_mm)
        layout.sharp |= sharp
        vertices, faces = _sewn(layout, extended).surface()
        solid, crossing = _rounded(layout, vertices + middle, faces, tolerance_mm)
        crowded = [joint for joint in range(len(layout.ends)) if layout.crowded(joint)]
        if not (rounds and crowded and len(crossing)):
            return solid
        # Groups that cross themselves once they are rounded to float32 stay sharp.
        places = solid.vertices[solid.faces[crossing, 0]] - middle
        centres = np.array([layout.walls[joint][0, :3] for joint in crowded])
        near = cKDTree(centres).query(places)[1]
        sharp |= {crowded[index] for index in near.tolist()}
    return solid


def lumen_pair(
    network: VesselNetwork,
    extend_ends_mm: float | FloatArray,
    extend_nodes: IntArray,
    *,
    facet_ratio: float = 0.0,
    fillet_ratio: float = 0.0,
) -> tuple[Solid, Solid]:
    """Two `lumen_solid`: with round ends, and with ``extend_nodes`` drawn out; sewn once.

    Parameters and errors are those of `lumen_solid`. Where an end that is drawn out is part of a
    group of junctions, or is drawn out by less than its half ball, they are made one by one.
    """
    _check(extend_ends_mm, FACET_TOLERANCE_MM, fillet_ratio)
    extended = extended_ends(network, extend_ends_mm, extend_nodes)
    alone = partial(lumen_solid, network, facet_ratio=facet_ratio, fillet_ratio=fillet_ratio)
    if not extended:
        solid = alone()
        return solid, solid
    pair = _pair(network, extended, facet_ratio, fillet_ratio)
    if pair is not None:
        return pair
    return alone(), alone(extend_ends_mm=extend_ends_mm, extend_nodes=extend_nodes)


def _pair(
    network: VesselNetwork, extended: dict[int, float], facet_ratio: float, fillet_ratio: float
) -> tuple[Solid, Solid] | None:
    middle, moved = _around_middle(network)
    layout = lay_out(moved, Facets(ratio=facet_ratio), fillet_ratio, None)
    others = {
        index: run
        for index, run in enumerate(layout.runs)
        if extended.keys() & {int(run.node[0]), int(run.node[-1])}
    }
    for run in others.values():
        for end in (0, -1):
            length = extended.get(int(run.node[end]), np.inf)
            if length < DOME_RADII * run.radius[end]:
                return None
    sewing = _sewn(layout, extended)
    vertices, faces = sewing.surface()
    drawn_out, crossing = _rounded(layout, vertices + middle, faces, FACET_TOLERANCE_MM)
    if len(crossing) and fillet_ratio > 0.0:
        return None
    if not _united(layout):
        crossings = find_crossings(drawn_out.vertices, drawn_out.faces)
        drawn_out = replace(drawn_out, uncrossed=len(crossings.pairs) == 0)
    swapped = with_other_tubes(drawn_out, middle, layout, sewing, others)
    if swapped is None or (drawn_out.uncrossed and not swapped.uncrossed):
        return None
    return swapped, drawn_out


def _around_middle(network: VesselNetwork) -> tuple[FloatArray, VesselNetwork]:
    """The network's middle, and the network around it: far from the origin no digits are lost."""
    middle = np.round(0.5 * (network.points.min(axis=0) + network.points.max(axis=0)))
    return middle, network.moved(-middle)


def _sewn(layout: Layout, extended: dict[int, float]) -> Sewing:
    """All parts sewn; the layout's runs are drawn out at the nodes ``extended``."""
    joined = layout.joint_of()
    shapes: list[tuple[EndShape, EndShape]] = []
    for index, run in enumerate(layout.runs):
        ends: list[EndShape] = []
        for end in (0, 1):
            node = int(run.node[-end])
            ends.append("flat" if (index, end) in joined or node in extended else "round")
        shapes.append((ends[0], ends[1]))
        layout.runs[index] = extend_ends(run, extended)
    return sew_parts(layout, shapes)


def _rounded(
    layout: Layout, vertices: FloatArray, faces: IntArray, tolerance_mm: float
) -> tuple[Solid, IntArray]:
    """The solid in float32, mended where parts were united, and its faces that cross still."""
    united = _united(layout)
    solid = solid_from_mesh(vertices, faces, "the lumens' union", mend=not united)
    return mended_solid(solid, tolerance_mm) if united else (solid, np.empty(0, np.int64))


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
    chosen = free if extend_nodes is None else np.asarray(extend_nodes, dtype=np.int64)
    strange = np.setdiff1d(chosen, free)
    if len(strange):
        raise SolidError(
            f"extend_nodes: node {strange[0]} isn't a free end of the network; "
            f"choose from its {len(free)} free ends"
        )
    lengths = np.asarray(extend_ends_mm, dtype=np.float64)
    if lengths.shape not in ((), chosen.shape):
        raise SolidError(
            f"extend_ends_mm has {lengths.size} lengths for {len(chosen)} ends; give one for each, "
            "or one for all"
        )
    every = np.broadcast_to(lengths, chosen.shape)
    return {
        node: length
        for node, length in zip(chosen.tolist(), every.tolist(), strict=True)
        if length > 0.0
    }


def extend_ends(run: Chain, extended: dict[int, float]) -> Chain:
    """The same run, longer at the nodes ``extended`` by the lengths given there, mm.

    A piece of one radius goes on to the new end: one piece more would be taken for a vessel that
    isn't joined to what its own junction joins.
    """
    points, radius, node = run.points, run.radius, run.node
    for at, inner in ((0, 1), (-1, -2)):
        length = extended.get(int(run.node[at]))
        if length is None:
            continue
        longer = _drawn_out(points, radius, at, length)
        if radius[at] == radius[inner]:
            points = points.copy()
            points[at] = longer[0][at]
        else:
            points, radius = longer
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


def tube_solid(
    network: VesselNetwork,
    wall_mm: float,
    *,
    open_nodes: IntArray | None = None,
    fillet_ratio: float = 0.0,
) -> Solid:
    """Return the union of all vessels widened by ``wall_mm``, minus their lumens.

    Parameters
    ----------
    network : VesselNetwork
        Its radii are the lumens'.
    wall_mm : float, mm
    open_nodes : (k,) int64, optional
        Free ends that are open, cut square at the node; all of them by default. The others
        are closed by a wall of the same thickness.
    fillet_ratio : float
        As `lumen_solid` has it, for the lumen and the outside alike.

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
    outer = tube_outside(network, wall_mm, open_nodes=ends, fillet_ratio=fillet_ratio)
    inner = lumen_solid(
        network, extend_ends_mm=beyond, extend_nodes=ends, fillet_ratio=fillet_ratio
    )
    wall = subtract(solid_manifold(outer, "the outside"), [solid_manifold(inner, "the lumens")])
    return solid_from_manifold(wall, "the tubes")


def tube_outside(
    network: VesselNetwork,
    wall_mm: float,
    *,
    open_nodes: IntArray | None = None,
    fillet_ratio: float = 0.0,
) -> Solid:
    """Return `tube_solid` before its lumens are taken out; parameters and errors are the same."""
    if not 0.0 < wall_mm < np.inf:
        raise SolidError(f"wall_mm {wall_mm:g}; give a thickness above 0")
    ends = free_ends(network) if open_nodes is None else np.asarray(open_nodes, dtype=np.int64)
    # A hundredth of the wall, so that the end's face is flat and no seam lies on the node's plane.
    return lumen_solid(
        replace(network, radius=network.radius + wall_mm),
        extend_ends_mm=0.01 * wall_mm if len(ends) else 0.0,
        extend_nodes=ends,
        fillet_ratio=fillet_ratio,
    )

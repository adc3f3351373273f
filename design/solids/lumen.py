"""The open space of a network's vessels as one solid."""

from __future__ import annotations

import numpy as np

from design.errors import SolidError
from design.network import FloatArray, IntArray, VesselNetwork
from design.solids.chains import Chain
from design.solids.facets import FACET_TOLERANCE_MM
from design.solids.runs import free_ends
from design.solids.smooth.assemble import sewn
from design.solids.smooth.layout import lay_out
from design.solids.snap import solid_from_mesh
from design.solids.solid import Solid
from design.solids.tube import EndShape


def lumen_solid(
    network: VesselNetwork,
    *,
    extend_ends_mm: float = 0.0,
    extend_nodes: IntArray | None = None,
    tolerance_mm: float = FACET_TOLERANCE_MM,
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
    extend_ends_mm : float, mm
        By how much free ends are drawn out, so that they pass cleanly through a construct's
        face; 0 leaves them round.
    extend_nodes : (k,) int64, optional
        The free ends that are extended (see `open_ends`); all of them by default.
    tolerance_mm : float, mm
        Greatest distance between facet and arc.
    fillet_ratio : float
        Radius of the fillet at a junction over that of its thinnest vessel: radii within a tree
        differ twentyfold, and so must its fillets. 0, the default, leaves seams sharp; 0.5 is
        round. Where neighbouring junctions leave no room it is reduced, by steps to a tenth and
        then to none.
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
    extended = _extended(network, extend_ends_mm, extend_nodes)
    # Around the middle of the network, so that far from the origin no digits are lost in between.
    middle = np.round(0.5 * (network.points.min(axis=0) + network.points.max(axis=0)))
    layout = lay_out(network.moved(-middle), tolerance_mm, fillet_ratio, fillet_mm)
    joined = layout.joint_of()
    shapes: list[tuple[EndShape, EndShape]] = []
    for index, run in enumerate(layout.runs):
        ends: list[EndShape] = []
        for end in (0, 1):
            node = int(run.node[-end])
            ends.append("flat" if (index, end) in joined or node in extended else "round")
        shapes.append((ends[0], ends[1]))
        layout.runs[index] = _with_ends_drawn_out(run, extended, extend_ends_mm)
    vertices, faces = sewn(layout, shapes, tolerance_mm)
    return solid_from_mesh(vertices + middle, faces, "the lumens' union")


def _check(extend_ends_mm: float, tolerance_mm: float, fillet: float) -> None:
    if not (extend_ends_mm >= 0.0 and tolerance_mm > 0.0):
        raise SolidError(
            f"extend_ends_mm {extend_ends_mm:g} and tolerance_mm {tolerance_mm:g} mm: give a "
            "length of at least 0 and a tolerance above 0"
        )
    if not 0.0 <= fillet < np.inf:
        raise SolidError(f"fillet {fillet:g}; give a radius of at least 0 (0: sharp seams)")


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


def _with_ends_drawn_out(run: Chain, extended: set[int], length_mm: float) -> Chain:
    points, radius, node = run.points, run.radius, run.node
    for at in (0, -1):
        if int(run.node[at]) in extended:
            points, radius = _drawn_out(points, radius, at, length_mm)
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

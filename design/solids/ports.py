"""Which of a network's ends open through the surface of a body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from design.network import FloatArray, IntArray, VesselNetwork
from design.solids.runs import free_ends
from design.solids.solid import Solid

Array = NDArray[np.float64]


def open_ends(network: VesselNetwork, body: Solid, extend_ends_mm: float) -> IntArray:
    """Free ends that are ports: at the surface, or outside, and leading out.

    An end is at the surface within one radius of it, where its round cap would breach it. It
    leads out when the end drawn out by ``extend_ends_mm`` lies outside the body. Ends deeper
    inside are terminals, which stay closed.

    Parameters
    ----------
    network : VesselNetwork
    body : Solid
    extend_ends_mm : float, mm
        As will be given to `lumen_solid`.

    Returns
    -------
    (k,) int64
        Nodes, for `lumen_solid`'s ``extend_nodes``.
    """
    nodes, outward, radius = _free_ends(network)
    position = network.nodes[nodes]
    near = surface_distance(body, position) <= radius
    reaches = ~inside(body, position) | near
    leads_out = ~inside(body, position + extend_ends_mm * outward)
    return nodes[reaches & leads_out]


def _free_ends(network: VesselNetwork) -> tuple[IntArray, FloatArray, FloatArray]:
    """Node, unit vector out of the vessel, and radius at each free end."""
    nodes = free_ends(network)
    is_free = np.zeros(len(network.nodes), dtype=bool)
    is_free[nodes] = True
    outward = np.zeros((len(network.nodes), 3))
    radius = np.zeros(len(network.nodes))
    for vessel in np.flatnonzero(is_free[network.vessel_nodes].any(axis=1)).tolist():
        points, radii = network.polyline(vessel)
        for node, tip, inner in zip(network.vessel_nodes[vessel], (0, -1), (1, -2), strict=True):
            if is_free[node]:
                step = points[tip] - points[inner]
                outward[node] = step / np.linalg.norm(step)
                radius[node] = radii[tip]
    return nodes, outward[nodes], radius[nodes]


def inside(body: Solid, points: FloatArray) -> NDArray[np.bool_]:
    """Whether each of ``points`` (n, 3) lies in ``body``, by its winding number.

    Sum of the faces' solid angles over 4π (Van Oosterom & Strackee 1983,
    doi 10.1109/TBME.1983.325207); 1 inside, 0 outside. One pass over all faces a point.
    """
    corners = body.vertices[body.faces]
    found = np.empty(len(points), dtype=bool)
    for index, point in enumerate(points):
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        triple = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
        found[index] = np.arctan2(triple, below).sum() > np.pi
    return found


def surface_distance(body: Solid, points: FloatArray) -> FloatArray:
    """Distance of each of ``points`` (n, 3) from the surface of ``body``, mm."""
    corners = body.vertices[body.faces]
    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    kept = length > 0.0
    a, b, c, normal = a[kept], b[kept], c[kept], normal[kept] / length[kept, None]
    return np.array([_nearest(point, a, b, c, normal) for point in points])


def _nearest(point: Array, a: Array, b: Array, c: Array, normal: Array) -> float:
    """Least distance to triangles: to the plane where the foot is within, else to the edges."""
    within = np.ones(len(a), dtype=bool)
    least = np.inf
    for tail, head in ((a, b), (b, c), (c, a)):
        edge, off = head - tail, point - tail
        within &= _dot(np.cross(normal, edge), off) >= 0.0
        along = np.clip(_dot(edge, off) / _dot(edge, edge), 0.0, 1.0)
        least = min(least, float(np.linalg.norm(off - along[:, None] * edge, axis=1).min()))
    heights = np.abs(_dot(normal, point - a))[within]
    return min(least, float(heights.min())) if len(heights) else least


def _dot(left: Array, right: Array) -> Array:
    product: Array = np.einsum("ij,ij->i", left, right)
    return product

"""Find the ports of a network: free vessel ends that open through a body's surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.bvh import build_triangle_tree, nearest_distances
from design.network import VesselNetwork
from design.solids.solid import Solid
from design.solids.tube import free_ends
from design.tissue.grid import enclosed
from kernels.arrays import FloatArray, IntArray

Array = NDArray[np.float64]

EDGE_TOLERANCE = 1e-9
"""Share of a triangle by which a ray may miss it, so that none slips through between two."""


@dataclass(frozen=True)
class Port:
    """Where a free end leaves a body.

    Attributes
    ----------
    node : int
        The network's.
    inlet : bool
        Flow comes in there, as designed.
    at : (3,) float64, mm
        On the body's outer face.
    outward : (3,) float64
        Unit vector along the vessel.
    radius_mm : float, mm
        The vessel's.
    beyond_mm : float, mm
        From the node out to that face; negative where the node is outside.
    wall_mm : float, mm
        Of the body that the vessel's axis passes beyond the node.
    clear_mm : float, mm
        From that face on until the axis meets the body again; infinite where it doesn't.
    """

    node: int
    inlet: bool
    at: FloatArray
    outward: FloatArray
    radius_mm: float
    beyond_mm: float
    wall_mm: float
    clear_mm: float = np.inf


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
    distance, within = depths(body, np.r_[position, position + extend_ends_mm * outward])
    count = len(nodes)
    reaches = ~within[:count] | (distance[:count] <= radius)
    leads_out = ~within[count:]
    return nodes[reaches & leads_out]


def find_ports(
    network: VesselNetwork, body: Solid, nodes: IntArray, what: str, *, outermost: bool = False
) -> list[Port]:
    """Where the axes of the free ends ``nodes`` (k,) leave ``body``.

    They leave it at the first face behind which it is free by more than the vessel's radius: less
    is a crevice of that face.

    Parameters
    ----------
    network : VesselNetwork
    body : Solid
    nodes : (k,) int64
        Free ends, as `open_ends` finds them, or all of them.
    what : str
        Names the body in messages.
    outermost : bool
        Take the last face instead: that of a chamber's wall around the ends.

    Raises
    ------
    SolidError
        When a vessel drawn on beyond its end doesn't pass a face of the body.
    """
    wanted = set(np.asarray(nodes).tolist())
    ports = []
    for node, outward, radius in zip(*_free_ends(network), strict=True):
        if int(node) not in wanted:
            continue
        start = network.nodes[node]
        # From one radius within: a node may lie a little outside of the face.
        away = _faces_on(body, start - radius * outward, outward) - radius
        if len(away) == 0:
            place = ", ".join(f"{x:.4g}" for x in start)
            raise SolidError(
                f"the vessel that ends at node {node} ({place} mm) doesn't leave {what} through "
                "a face: let it end at one, or move its end to where one is"
            )
        inlet = _is_inlet(network, node)
        first, last, clear = float(away[0]), float(away[-1]), np.inf
        if not outermost and len(away) > 1:
            gaps = np.append(away[1::2], np.inf)[: len(away[::2])] - away[::2]
            leaves = int(np.argmax(gaps > radius))
            last, clear = float(away[::2][leaves]), float(gaps[leaves])
        wall = last - first if outermost and len(away) > 1 else last
        at = start + last * outward
        ports.append(Port(int(node), inlet, at, outward, float(radius), last, wall, clear))
    return ports


def end_ports(network: VesselNetwork, nodes: IntArray) -> list[Port]:
    """The free ends ``nodes`` (k,) themselves as ports: those of tubes, cut square there."""
    wanted = set(np.asarray(nodes).tolist())
    return [
        Port(int(node), _is_inlet(network, node), network.nodes[node], out, float(radius), 0.0, 0.0)
        for node, out, radius in zip(*_free_ends(network), strict=True)
        if int(node) in wanted
    ]


def _is_inlet(network: VesselNetwork, node: int) -> bool:
    return bool(np.any(network.vessel_nodes[:, 0] == node))


def _faces_on(body: Solid, start: Array, way: Array) -> Array:
    """Distances (k,), ascending, at which a ray goes through faces (Möller & Trumbore 1997)."""
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    one, two = b - a, c - a
    across = np.cross(way, two)
    det = _dot(one, across)
    met = np.abs(det) > 0.0
    scale = np.divide(1.0, det, where=met, out=np.zeros_like(det))
    to = start - a
    u = _dot(to, across) * scale
    turned = np.cross(to, one)
    v = turned @ way * scale
    t = _dot(two, turned) * scale
    met &= (
        (u >= -EDGE_TOLERANCE)
        & (v >= -EDGE_TOLERANCE)
        & (u + v <= 1.0 + EDGE_TOLERANCE)
        & (t > 0.0)
    )
    # A ray through an edge meets two faces at one place.
    return np.unique(np.round(t[met], 6))


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


def depths(body: Solid, points: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Distance (n,) from the surface of ``body``, mm, and whether each of ``points`` lies in it."""
    tree = build_triangle_tree(body.vertices, body.faces.astype(np.int32))
    return nearest_distances(tree, points), enclosed(tree, points)


def _dot(left: Array, right: Array) -> Array:
    product: Array = np.einsum("ij,ij->i", left, right)
    return product

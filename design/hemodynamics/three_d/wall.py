"""Signed distance from a network's lumen walls, rounded at junctions; project points on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.cells import Cells, sort_boxes
from design.hemodynamics.three_d.lumen_mesh import MeshPort
from design.hemodynamics.three_d.wall_field import distances, project, radii
from design.network import VesselNetwork
from design.solids.smooth.fillet import COLUMNS, wall_rows
from kernels.arrays import FloatArray, IntArray

BEYOND = 3.0
"""Radii by which the field goes on beyond a free end, so that it is a tube's there."""

_KINK = np.cos(np.radians(15.0))
"""Where a polyline turns by more it has a fillet, as at a node; not where its pieces are shorter
than a radius, as those of a rough centreline are."""

_ROOM = 2.0
"""Over the distance of the seam's end: with `FADE` a fillet is whole to 4/3 of it."""


@dataclass(frozen=True)
class LumenWall:
    """Signed distance from the lumens' wall, negative inside, and what lies on it.

    Pieces are cones with a ball at either end (`wall_distance`), united and closed by a rolling
    ball (`rounded_distance`) whose radius is the junction's own: the lumen that `lumen_solid`
    makes, as a function.

    Attributes
    ----------
    rows : (n, 10) float64
        Of `wall_rows`, free ends drawn out by `BEYOND` radii.
    joints : (m, 6) float64, mm
        Place, ball's radius, fillet's radius and how far it reaches, of each node where vessels
        meet and each kink of a polyline.
    cells : Cells
        Pieces near a place.
    ports : tuple of MeshPort
    ratio : float
        Wanted edge length over the lumen's radius.
    """

    rows: FloatArray
    joints: FloatArray
    cells: Cells
    ports: tuple[MeshPort, ...]
    ratio: float

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance at each of ``points`` (n, 3), mm; right in sign and zero."""
        signed = np.empty(len(points))
        distances(self.rows, self.joints, self.cells, np.ascontiguousarray(points), signed)
        return signed

    def size(self, points: FloatArray) -> FloatArray:
        """Wanted edge length at each point, mm: a share of the nearest vessel's radius."""
        sizes = np.empty(len(points))
        radii(self.rows, self.cells, np.ascontiguousarray(points), sizes)
        return self.ratio * sizes

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        """Points moved onto the wall, onto their port, or onto the rim between (see `Shape`)."""
        moved = np.array(points, dtype=np.float64)
        port = np.where(patch < 0, -1 - patch, patch) - 1
        plane = np.zeros((len(points), 3))
        for k, each in enumerate(self.ports):
            mine = port == k
            plane[mine] = each.outward
            moved[mine] -= np.outer((moved[mine] - each.centre) @ each.outward, each.outward)
        project(self.rows, self.joints, self.cells, moved, plane, patch <= 0)
        return moved


def lumen_wall(network: VesselNetwork, fillet_ratio: float, ratio: float) -> LumenWall:
    """Make the field of a network's lumens.

    Parameters
    ----------
    network : VesselNetwork
    fillet_ratio : float
        Radius of the rolling ball at a junction over that of its thinnest vessel.
    ratio : float
        Wanted edge length over the lumen's radius.

    Raises
    ------
    FlowError
        For a vessel without length, or of radius 0.
    """
    start, end, r0, r1, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    for bad, what in ((length <= 0.0, "length"), (np.minimum(r0, r1) <= 0.0, "radius")):
        if bad.any():
            raise FlowError(
                f"vessel {int(vessel[bad][0])} has a piece without {what}; mend the network first"
            )
    axis = (end - start) / length[:, None]
    ports = free_ends(network)
    slope = (r1 - r0) / length
    ends = [_beyond(network, port) for port in ports]
    rows = np.concatenate(
        [wall_rows(start, axis, length, r0, slope), np.reshape(ends, (-1, COLUMNS))]
    )
    joints = _joints(network, fillet_ratio)
    reach = 3.0 * (joints[:, 4].max() if len(joints) else 0.0)
    return LumenWall(rows, joints, _cells_of(rows, reach), ports, ratio)


def free_ends(network: VesselNetwork) -> tuple[MeshPort, ...]:
    """A port at every free end, square to its vessel."""
    inlets = set(network.inlets().tolist())
    ports = []
    for node in np.flatnonzero(network.degree() == 1).tolist():
        vessel, side = (int(x[0]) for x in np.nonzero(network.vessel_nodes == node))
        points, radius = network.polyline(vessel)
        if side == 1:
            points, radius = points[::-1], radius[::-1]
        outward = points[0] - points[1]
        outward = outward / np.linalg.norm(outward)
        ports.append(MeshPort(node, points[0], outward, float(radius[0]), node in inlets))
    return tuple(ports)


def _beyond(network: VesselNetwork, port: MeshPort) -> FloatArray:
    """The row of a piece that draws a free end out."""
    length = np.array([BEYOND * port.radius_mm])
    return wall_rows(
        port.centre[None], port.outward[None], length, np.array([port.radius_mm]), np.zeros(1)
    )


def _joints(network: VesselNetwork, fillet_ratio: float) -> FloatArray:
    """Rows of `LumenWall.joints`: nodes where vessels meet, and kinks of polylines."""
    at, way, radius, place = _branches(network)
    order = np.argsort(at, kind="stable")
    rows = []
    for mine in np.split(order, np.flatnonzero(np.diff(at[order])) + 1):
        if len(mine) > 1:
            ball = fillet_ratio * float(radius[mine].min())
            seam = _seam(way[mine], radius[mine], ball)
            rows.append([*place[mine[0]], radius[mine].max(), ball, seam])
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


def _branches(network: VesselNetwork) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """What leaves each node or kink: its number, unit direction, radius, place."""
    start, end, r0, r1, _ = network.pieces()
    way = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    inner, first = np.arange(len(network.points)), network.offset[:-1]
    last = network.offset[1:] - 1
    # Polylines' ends go by their nodes' numbers, inner points come after these.
    number = len(network.nodes) + inner
    number[first], number[last] = network.vessel_nodes.T
    begins = np.setdiff1d(inner, last)
    at = np.concatenate([number[begins], number[begins + 1]])
    ways = np.concatenate([way, -way])
    within = np.setdiff1d(begins, first)
    piece = np.searchsorted(begins, within)
    along = np.einsum("ij,ij->i", way[piece], way[piece - 1])
    long = np.linalg.norm(end - start, axis=1) > np.minimum(r0, r1)
    kink = (along < _KINK) & long[piece] & long[piece - 1]
    smooth = np.isin(at, number[within[~kink]])
    radius, place = np.concatenate([r0, r1]), np.concatenate([start, end])
    return at[~smooth], ways[~smooth], radius[~smooth], place[~smooth]


def _seam(way: FloatArray, radius: FloatArray, ball: float) -> float:
    """How far from a node the ball still touches two vessels, mm, with room for it to fade.

    Its centre is as far from both axes as it is from their walls, in the plane of the two:
    (r + ρ) / sin(θ/2) from the node at an angle θ between them.
    """
    i, j = np.triu_indices(len(way), 1)
    half = np.sqrt(np.clip(0.5 * (1.0 - np.einsum("ij,ij->i", way[i], way[j])), 1e-4, None))
    wide = np.maximum(radius[i], radius[j]) + ball
    return float(_ROOM * (wide / half).max())


def _cells_of(rows: FloatArray, reach: float) -> Cells:
    """Pieces sorted by the places within ``reach`` or half a radius of them."""
    start, step = rows[:, :3], rows[:, 3:6] * rows[:, 6:7]
    wide = np.maximum(rows[:, 7], rows[:, 7] + rows[:, 8] * rows[:, 6])
    margin = (wide + np.maximum(reach, 0.5 * wide))[:, None]
    low, high = np.minimum(start, start + step) - margin, np.maximum(start, start + step) + margin
    return sort_boxes(low, high, float(2.0 * np.median(margin)))

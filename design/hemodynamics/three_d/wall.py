"""The wall of a network's lumens as a smooth field: pieces of vessels, rounded where they meet."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.cells import Cells, sort_boxes
from design.hemodynamics.three_d.lumen_mesh import MeshPort
from design.hemodynamics.three_d.wall_field import distances, project, radii
from design.network import FloatArray, IntArray, VesselNetwork
from design.solids.smooth.fillet import COLUMNS, wall_rows

BEYOND = 3.0
"""Radii by which the field goes on beyond a free end, so that it is a tube's there."""


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
    joints : (m, 5) float64, mm
        Place, ball's radius and fillet's radius of each node where vessels meet.
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
        found = np.empty(len(points))
        distances(self.rows, self.joints, self.cells, np.ascontiguousarray(points), found)
        return found

    def size(self, points: FloatArray) -> FloatArray:
        """Wanted edge length at each point, mm: a share of the nearest vessel's radius."""
        found = np.empty(len(points))
        radii(self.rows, self.cells, np.ascontiguousarray(points), found)
        return self.ratio * found

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
    ports = tuple(_ports(network))
    slope = (r1 - r0) / length
    ends = [_beyond(network, port) for port in ports]
    rows = np.concatenate(
        [wall_rows(start, axis, length, r0, slope), np.reshape(ends, (-1, COLUMNS))]
    )
    joints = _joints(network, fillet_ratio)
    reach = 3.0 * (joints[:, 4].max() if len(joints) else 0.0)
    return LumenWall(rows, joints, _cells_of(rows, reach), ports, ratio)


def _ports(network: VesselNetwork) -> list[MeshPort]:
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
    return ports


def _beyond(network: VesselNetwork, port: MeshPort) -> FloatArray:
    """The row of a piece that draws a free end out."""
    length = np.array([BEYOND * port.radius_mm])
    return wall_rows(
        port.centre[None], port.outward[None], length, np.array([port.radius_mm]), np.zeros(1)
    )


def _joints(network: VesselNetwork, fillet_ratio: float) -> FloatArray:
    ends = np.stack([network.offset[:-1], network.offset[1:] - 1], axis=1)
    radius = network.radius[ends]
    thin, wide = np.full(len(network.nodes), inf), np.zeros(len(network.nodes))
    np.minimum.at(thin, network.vessel_nodes.ravel(), radius.ravel())
    np.maximum.at(wide, network.vessel_nodes.ravel(), radius.ravel())
    inner = network.degree() > 1
    return np.column_stack([network.nodes[inner], wide[inner], fillet_ratio * thin[inner]]).astype(
        np.float64
    )


def _cells_of(rows: FloatArray, reach: float) -> Cells:
    """Pieces sorted by the places within ``reach`` or half a radius of them."""
    start, step = rows[:, :3], rows[:, 3:6] * rows[:, 6:7]
    wide = np.maximum(rows[:, 7], rows[:, 7] + rows[:, 8] * rows[:, 6])
    margin = (wide + np.maximum(reach, 0.5 * wide))[:, None]
    low, high = np.minimum(start, start + step) - margin, np.maximum(start, start + step) + margin
    return sort_boxes(low, high, float(2.0 * np.median(margin)))

"""The wall of a network's lumens as a smooth field: pieces of vessels, rounded where they meet."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.three_d.cells import Cells, sort_boxes
from design.hemodynamics.three_d.lumen_mesh import MeshPort
from design.network import FloatArray, IntArray, VesselNetwork
from design.solids.smooth.fillet import COLUMNS, rounded_distance, wall_distance, wall_rows
from kernels import jit

BEYOND = 3.0
"""Radii by which the field goes on beyond a free end, so that it is a tube's there."""

_MOST = 24
"""Pieces that are looked at around a point."""

_SHARPNESS = 8
"""Power by which a junction's fillet loses its say with distance."""

BoolArray = NDArray[np.bool_]

_STEPS = 12
_SETTLED = 1e-9
_PROBE = 1e-4


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
        _distances(self.rows, self.joints, self.cells, np.ascontiguousarray(points), found)
        return found

    def size(self, points: FloatArray) -> FloatArray:
        """Wanted edge length at each point, mm: a share of the nearest vessel's radius."""
        found = np.empty(len(points))
        _radii(self.rows, self.cells, np.ascontiguousarray(points), found)
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
        _project(self.rows, self.joints, self.cells, moved, plane, patch <= 0)
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


@jit
def _near(rows: FloatArray, cells: Cells, x: float, y: float, z: float, found: IntArray) -> int:
    """Pieces near a place, into ``found``; how many."""
    i = int(np.floor((x - cells.low[0]) / cells.size))
    j = int(np.floor((y - cells.low[1]) / cells.size))
    k = int(np.floor((z - cells.low[2]) / cells.size))
    if min(i, j, k) < 0 or i >= cells.shape[0] or j >= cells.shape[1] or k >= cells.shape[2]:
        return 0
    cell = (i * cells.shape[1] + j) * cells.shape[2] + k
    count = 0
    for at in range(cells.first[cell], cells.first[cell + 1]):
        if count < len(found):
            found[count] = cells.item[at]
            count += 1
    return count


@jit
def _fillet(joints: FloatArray, x: float, y: float, z: float) -> float:
    """Radius of the rolling ball: the nearest junction's, blended between two."""
    total = weight = 0.0
    for m in range(len(joints)):
        dx, dy, dz = x - joints[m, 0], y - joints[m, 1], z - joints[m, 2]
        near = (dx * dx + dy * dy + dz * dz) / joints[m, 3] ** 2 + 1e-12
        share = near ** (-_SHARPNESS / 2)
        total += share * joints[m, 4]
        weight += share
    return total / weight if weight > 0.0 else 0.0


@jit
def field(
    rows: FloatArray, joints: FloatArray, cells: Cells, at: FloatArray, g: FloatArray
) -> float:
    """Signed distance at a place, mm; its gradient into ``g`` (3,). inf where no piece is near."""
    x, y, z = at[0], at[1], at[2]
    found = np.empty(256, np.int64)
    count = _near(rows, cells, x, y, z, found)
    least, second = inf, inf
    near = np.empty((_MOST, COLUMNS))
    apart = np.empty(_MOST)
    used = 0
    for n in range(count):
        a, gx, gy, gz = wall_distance(rows[found[n]], x, y, z)
        if a < least:
            least, second = a, least
            g[0], g[1], g[2] = gx, gy, gz
        else:
            second = min(second, a)
        place = used
        if used == _MOST:
            place = int(np.argmax(apart))
            if apart[place] <= a:
                continue
        else:
            used += 1
        near[place], apart[place] = rows[found[n]], a
    if used < 2:
        return least
    rho = _fillet(joints, x, y, z)
    if rho <= 0.0 or second > 2.0 * rho or least >= rho:
        return least
    near = near[:used]
    value = rounded_distance(near, rho, x, y, z)
    step = _PROBE * rho
    g[0] = rounded_distance(near, rho, x + step, y, z) - rounded_distance(near, rho, x - step, y, z)
    g[1] = rounded_distance(near, rho, x, y + step, z) - rounded_distance(near, rho, x, y - step, z)
    g[2] = rounded_distance(near, rho, x, y, z + step) - rounded_distance(near, rho, x, y, z - step)
    g /= 2.0 * step
    return value


@jit
def _distances(
    rows: FloatArray, joints: FloatArray, cells: Cells, points: FloatArray, found: FloatArray
) -> None:
    g = np.empty(3)
    for n in range(len(points)):
        found[n] = field(rows, joints, cells, points[n], g)


@jit
def _radii(rows: FloatArray, cells: Cells, points: FloatArray, found: FloatArray) -> None:
    """Radius of the vessel whose wall is nearest, or that holds the place deepest."""
    near = np.empty(256, np.int64)
    for n in range(len(points)):
        least, found[n] = inf, 0.0
        for m in range(_near(rows, cells, points[n, 0], points[n, 1], points[n, 2], near)):
            row = rows[near[m]]
            a, _, _, _ = wall_distance(row, points[n, 0], points[n, 1], points[n, 2])
            s = 0.0
            for k in range(3):
                s += (points[n, k] - row[k]) * row[3 + k]
            radius = row[7] + row[8] * min(max(s, 0.0), row[6])
            if abs(a) / radius < least:
                least, found[n] = abs(a) / radius, radius


@jit
def _project(
    rows: FloatArray,
    joints: FloatArray,
    cells: Cells,
    points: FloatArray,
    plane: FloatArray,
    move: BoolArray,
) -> None:
    """Newton's steps along the gradient, within a plane where its normal isn't 0."""
    g = np.empty(3)
    for n in range(len(points)):
        if not move[n]:
            continue
        for _ in range(_STEPS):
            value = field(rows, joints, cells, points[n], g)
            if value == inf:
                break
            across = g[0] * plane[n, 0] + g[1] * plane[n, 1] + g[2] * plane[n, 2]
            g -= across * plane[n]
            square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2]
            if square < 1e-6:
                break
            points[n] -= value / square * g
            if abs(value) < _SETTLED * sqrt(square):
                break

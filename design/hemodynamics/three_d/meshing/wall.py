"""Signed distance from a network's lumen walls, rounded at junctions; project points on them."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.meshing.lumen_mesh import MeshPort
from design.network import VesselNetwork
from design.solids.smooth.fillet import COLUMNS, rounded_distance, wall_distance, wall_rows
from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray


class _Field(NamedTuple):
    """Constants of the wall's signed distance."""

    beyond: float = 3.0  # radii by which a free end goes on, so that the field is a tube's there
    # A polyline that turns by more has a fillet, unless its pieces are shorter than a radius, as
    # those of a rough centreline are.
    kink: float = float(np.cos(np.radians(15.0)))
    seam: float = 2.0  # reach of a fillet over the distance of its seam's end
    fade: float = 3.0  # a fillet is whole up to 1 - 1/fade of its reach: 4/3 of its seam
    sharpness: int = 8  # power of distance by which fillets are blended
    pieces: int = 64  # nearest ones that make a fillet; a finely drawn curve has many
    probe: float = 1e-4  # of the fillet's radius: step of differences
    steps: int = 12  # Newton's, onto the wall
    flattest: float = 0.25  # least squared slope of a step; between walls the field is flat
    settled: float = 1e-9  # mm from the wall


FIELD: Final = _Field()
_MAX_CELLS: Final = 4_000_000
"""Of the grid that sorts pieces: 32 MB."""


class Cells(NamedTuple):
    """Boxes by the cells of a grid that they reach into."""

    low: FloatArray  # (3,), mm, corner of the grid
    size: float  # mm, of a cell
    shape: IntArray  # (3,)
    first: IntArray  # (cells + 1,), where each cell's boxes begin in ``item``
    item: IntArray  # (k,), numbers of boxes


@dataclass(frozen=True)
class LumenWall:
    """Signed distance from the lumens' wall, negative inside, and what lies on it.

    Pieces are cones with a ball at either end (`wall_distance`), united and closed by a rolling
    ball (`rounded_distance`) whose radius is the junction's own: the lumen that `lumen_solid`
    makes, as a function.
    """

    rows: FloatArray  # (n, 10), of `wall_rows`, free ends drawn out
    joints: FloatArray  # (m, 6), mm: place, radii of vessel and fillet, reach; of nodes and kinks
    cells: Cells  # pieces near a place
    ports: tuple[MeshPort, ...]
    ratio: float  # wanted edge length over the lumen's radius

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance at ``points`` (n, 3), mm; right in sign and zero."""
        signed = np.empty(len(points))
        distances(self.rows, self.joints, self.cells, np.ascontiguousarray(points), signed)
        return signed

    def size(self, points: FloatArray) -> FloatArray:
        """Return the wanted edge length at each point, mm: a share of the nearest radius."""
        sizes = np.empty(len(points))
        radii(self.rows, self.cells, np.ascontiguousarray(points), sizes)
        return self.ratio * sizes

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        """Move points onto the wall, onto their port, or onto the rim between (see `Shape`)."""
        moved = np.array(points, dtype=np.float64)
        port = ports_of(patch)
        drop_into_ports(moved, port, self.ports)
        plane = np.array([*(each.outward for each in self.ports), np.zeros(3)])[port]
        project(self.rows, self.joints, self.cells, moved, plane, patch <= 0)
        return moved


def ports_of(patch: IntArray) -> IntArray:
    """Return the port of each patch or rim (see `Shape`); -1 for the wall."""
    return np.where(patch < 0, -1 - patch, patch) - 1


def drop_into_ports(points: FloatArray, port: IntArray, ports: tuple[MeshPort, ...]) -> None:
    """Move points into the plane of their port, in place; -1 for none."""
    for k, each in enumerate(ports):
        mine = port == k
        points[mine] -= np.outer((points[mine] - each.centre) @ each.outward, each.outward)


def lumen_wall(network: VesselNetwork, fillet_ratio: float, ratio: float) -> LumenWall:
    """Make the field of a network's lumens.

    ``fillet_ratio`` is the rolling ball's radius at a junction over that of its thinnest vessel,
    ``ratio`` the wanted edge length over the lumen's radius.

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
    # Free ends go on.
    wide = np.array([port.radius_mm for port in ports])
    rows = wall_rows(
        np.concatenate([start, *(port.centre[None] for port in ports)]),
        np.concatenate([axis, *(port.outward[None] for port in ports)]),
        np.concatenate([length, FIELD.beyond * wide]),
        np.concatenate([r0, wide]),
        np.concatenate([slope, np.zeros(len(ports))]),
    )
    joints = _joints(network, fillet_ratio)
    reach = 3.0 * (joints[:, 4].max() if len(joints) else 0.0)
    return LumenWall(rows, joints, _cells_of(rows, reach), ports, ratio)


def free_ends(network: VesselNetwork) -> tuple[MeshPort, ...]:
    """Make a port at every free end, square to its vessel."""
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


def _joints(network: VesselNetwork, fillet_ratio: float) -> FloatArray:
    """Return the rows of `LumenWall.joints`: nodes where vessels meet, kinks of polylines."""
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
    """Return node or kink, unit direction, radius and place of each branch that leaves one."""
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
    kink = (along < FIELD.kink) & long[piece] & long[piece - 1]
    smooth = np.isin(at, number[within[~kink]])
    radius, place = np.concatenate([r0, r1]), np.concatenate([start, end])
    return at[~smooth], ways[~smooth], radius[~smooth], place[~smooth]


def _seam(way: FloatArray, radius: FloatArray, ball: float) -> float:
    """Return the reach of a node's fillet, mm.

    The ball's centre is as far from both axes as it is from their walls, in the plane of the two:
    (r + ρ) / sin(θ/2) from the node at an angle θ between them.
    """
    i, j = np.triu_indices(len(way), 1)
    half = np.sqrt(np.clip(0.5 * (1.0 - np.einsum("ij,ij->i", way[i], way[j])), 1e-4, None))
    wide = np.maximum(radius[i], radius[j]) + ball
    return float(FIELD.seam * (wide / half).max())


def _cells_of(rows: FloatArray, reach: float) -> Cells:
    """Sort pieces into cells of places within ``reach`` or half a radius of them."""
    start, step = rows[:, :3], rows[:, 3:6] * rows[:, 6:7]
    wide = np.maximum(rows[:, 7], rows[:, 7] + rows[:, 8] * rows[:, 6])
    margin = (wide + np.maximum(reach, 0.5 * wide))[:, None]
    low, high = np.minimum(start, start + step) - margin, np.maximum(start, start + step) + margin
    return sort_boxes(low, high, float(2.0 * np.median(margin)))


@jit
def _near(cells: Cells, x: float, y: float, z: float) -> tuple[int, int]:
    """Return where the pieces near a place begin and end in the cells' items."""
    i = int(np.floor((x - cells.low[0]) / cells.size))
    j = int(np.floor((y - cells.low[1]) / cells.size))
    k = int(np.floor((z - cells.low[2]) / cells.size))
    if min(i, j, k) < 0 or i >= cells.shape[0] or j >= cells.shape[1] or k >= cells.shape[2]:
        return 0, 0
    cell = (i * cells.shape[1] + j) * cells.shape[2] + k
    return int(cells.first[cell]), int(cells.first[cell + 1])


@jit
def _fillet(joints: FloatArray, x: float, y: float, z: float) -> float:
    """Return the rolling ball's radius: the nearest junction's, blended between two.

    It goes to 0 beyond the junctions' seams: it would join vessels that run side by side.
    """
    total = weight = reached = 0.0
    for m in range(len(joints)):
        dx, dy, dz = x - joints[m, 0], y - joints[m, 1], z - joints[m, 2]
        away = dx * dx + dy * dy + dz * dz
        near = away / joints[m, 3] ** 2 + 1e-12
        reached = max(reached, min(1.0, FIELD.fade * (1.0 - sqrt(away) / joints[m, 5])))
        share = near ** (-FIELD.sharpness / 2)
        total += share * joints[m, 4]
        weight += share
    return reached * total / weight if weight > 0.0 and reached > 0.0 else 0.0


@jit
def _sharp(
    rows: FloatArray,
    cells: Cells,
    at: FloatArray,
    g: FloatArray,
    near: FloatArray,
    distance: FloatArray,
) -> tuple[float, float, int]:
    """Return the distances from the nearest two pieces, and how many ``near`` holds.

    The nearest one's gradient goes into ``g`` (3,), rows of near pieces into ``near``, their
    distances into ``distance``.
    """
    least, second, used = inf, inf, 0
    begin, end = _near(cells, at[0], at[1], at[2])
    for n in range(begin, end):
        row = rows[cells.item[n]]
        a, gx, gy, gz = wall_distance(row, at[0], at[1], at[2])
        if a < least:
            least, second = a, least
            g[0], g[1], g[2] = gx, gy, gz
        else:
            second = min(second, a)
        place = used
        if used == len(distance):
            place = int(np.argmax(distance))
            if distance[place] <= a:
                continue
        else:
            used += 1
        near[place], distance[place] = row, a
    return least, second, used


@jit
def _rounded(near: FloatArray, rho: float, at: FloatArray, g: FloatArray) -> float:
    """Return the distance from the rounded pieces; its gradient, by differences, into ``g``."""
    x, y, z = at[0], at[1], at[2]
    step = FIELD.probe * rho
    g[0] = rounded_distance(near, rho, x + step, y, z) - rounded_distance(near, rho, x - step, y, z)
    g[1] = rounded_distance(near, rho, x, y + step, z) - rounded_distance(near, rho, x, y - step, z)
    g[2] = rounded_distance(near, rho, x, y, z + step) - rounded_distance(near, rho, x, y, z - step)
    g /= 2.0 * step
    return rounded_distance(near, rho, x, y, z)


@jit
def field(
    rows: FloatArray, joints: FloatArray, cells: Cells, at: FloatArray, g: FloatArray
) -> float:
    """Return the signed distance, mm, inf if no piece is near; its gradient into ``g`` (3,)."""
    near, distance = np.empty((FIELD.pieces, COLUMNS)), np.empty(FIELD.pieces)
    least, second, used = _sharp(rows, cells, at, g, near, distance)
    if used < 2:
        return least
    rho = _fillet(joints, at[0], at[1], at[2])
    if rho <= 0.0 or second > 2.0 * rho or least >= rho:
        return least
    return _rounded(near[:used], rho, at, g)


@jit
def distances(
    rows: FloatArray, joints: FloatArray, cells: Cells, points: FloatArray, signed: FloatArray
) -> None:
    """Write `field` at each of ``points`` (n, 3) into ``signed`` (n,)."""
    g = np.empty(3)
    for n in range(len(points)):
        signed[n] = field(rows, joints, cells, points[n], g)


@jit
def radii(rows: FloatArray, cells: Cells, points: FloatArray, sizes: FloatArray) -> None:
    """Write the radius of the vessel whose wall is nearest, or that holds the place deepest."""
    for n in range(len(points)):
        least, sizes[n] = inf, 0.0
        begin, end = _near(cells, points[n, 0], points[n, 1], points[n, 2])
        for m in range(begin, end):
            row = rows[cells.item[m]]
            a, _, _, _ = wall_distance(row, points[n, 0], points[n, 1], points[n, 2])
            s = 0.0
            for k in range(3):
                s += (points[n, k] - row[k]) * row[3 + k]
            radius = row[7] + row[8] * min(max(s, 0.0), row[6])
            if abs(a) / radius < least:
                least, sizes[n] = abs(a) / radius, radius


@jit
def project(
    rows: FloatArray,
    joints: FloatArray,
    cells: Cells,
    points: FloatArray,
    plane: FloatArray,
    move: BoolArray,
) -> None:
    """Take Newton's steps along the gradient, within a plane where its normal isn't 0."""
    g = np.empty(3)
    for n in range(len(points)):
        if not move[n]:
            continue
        for _ in range(FIELD.steps):
            value = field(rows, joints, cells, points[n], g)
            if value == inf:
                break
            across = g[0] * plane[n, 0] + g[1] * plane[n, 1] + g[2] * plane[n, 2]
            g -= across * plane[n]
            square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2]
            if square < 1e-6:
                break
            points[n] -= value / max(square, FIELD.flattest) * g
            if abs(value) < FIELD.settled * sqrt(square):
                break


def sort_boxes(low: FloatArray, high: FloatArray, size: float) -> Cells:
    """Sort boxes from ``low`` to ``high``, (n, 3) each, into cells of about ``size`` mm."""
    corner, span = low.min(axis=0), np.ptp(np.concatenate([low, high]), axis=0)
    size = max(size, float(np.cbrt(np.prod(span) / _MAX_CELLS)))
    shape = np.floor(span / size).astype(np.int64) + 1
    begin = np.floor((low - corner) / size).astype(np.int64)
    end = np.minimum(np.floor((high - corner) / size).astype(np.int64), shape - 1)
    side = end - begin + 1
    box = np.repeat(np.arange(len(low)), side.prod(axis=1))
    nth = np.arange(len(box)) - np.searchsorted(box, box)
    across, deep = side[box, 1], side[box, 2]
    step = np.stack([nth // (across * deep), nth // deep % across, nth % deep], axis=1)
    cell = np.ravel_multi_index(tuple((begin[box] + step).T), tuple(shape))
    first = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=int(shape.prod())))])
    return Cells(corner, size, shape, first, box[np.argsort(cell, kind="stable")])

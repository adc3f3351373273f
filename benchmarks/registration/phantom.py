"""Phantom block with vessels of exactly known walls, and its scan, without product code.

The design is a network of straight pieces in a block with three marks on its face; the print is
that, stretched; the scan samples the print's signed
distance voxel by voxel, lets light fade on its way down and adds speckle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import manifold3d
import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Edge of a cell that knows which pieces are near, mm.
CELL_MM = 0.25


@dataclass(frozen=True)
class Light:
    """An instrument and a gel.

    Attributes
    ----------
    counts : float
        Gel at the surface.
    attenuation_mm : float, 1/mm
    liquid : float
        Scattering of the liquid over the gel's.
    noise : float
        Counts of the floor.
    looks : int
        Speckle patterns averaged.
    """

    counts: float = 12_000.0
    attenuation_mm: float = 0.6
    liquid: float = 0.03
    noise: float = 8.0
    looks: int = 3


def cells_of(
    size: FloatArray, pieces: FloatArray, radius: FloatArray, balls: FloatArray
) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """A grid over the block: origin, counts, offsets and the pieces near each cell.

    Balls are numbered after the pieces.
    """
    reach = CELL_MM * math.sqrt(3) / 2 + 0.1
    origin = np.full(3, -2 * CELL_MM)
    count = np.ceil((size + 4 * CELL_MM) / CELL_MM).astype(np.int64)
    index = np.indices(tuple(count.tolist())).reshape(3, -1).T
    centre = origin + (index + 0.5) * CELL_MM
    near: list[IntArray] = []
    for k in range(len(pieces)):
        a, b = pieces[k, :3], pieces[k, 3:]
        t = np.clip((centre - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        away = np.linalg.norm(centre - a - t[:, None] * (b - a), axis=1)
        near.append(np.flatnonzero(away < radius[k].max() + reach))
    for ball in balls:
        near.append(np.flatnonzero(np.linalg.norm(centre - ball[:3], axis=1) < ball[3] + reach))
    owner = np.repeat(np.arange(len(near)), [len(n) for n in near])
    cell = np.concatenate(near)
    order = np.argsort(cell, kind="stable")
    offset = np.searchsorted(cell[order], np.arange(len(centre) + 1))
    return origin, count, offset, owner[order]


def render(
    shape: tuple[int, int, int],
    voxel_mm: tuple[float, float, float],
    to_part: FloatArray,
    size: FloatArray,
    pieces: FloatArray,
    radius: FloatArray,
    balls: FloatArray,
    cells: tuple[FloatArray, IntArray, IntArray, IntArray],
    light: Light,
    seed: int,
) -> NDArray[np.uint16]:
    """The scan, (nz, ny, nx)."""
    nx, ny, nz = shape
    numbers = np.array([light.counts, light.attenuation_mm, light.liquid, light.noise])
    return _render(
        nx, ny, nz, np.array(voxel_mm), np.ascontiguousarray(to_part), size, pieces, radius,
        balls, *cells, numbers, light.looks, np.uint64(seed + 1),
    )  # fmt: skip


@numba.njit(cache=True, inline="always")
def _mixed(state: Any) -> Any:
    """SplitMix64 (Steele, Lea & Flood 2014)."""
    z = state * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@numba.njit(cache=True)
def _gel(
    x: float, y: float, z: float, size: Any, pieces: Any, radius: Any, balls: Any,
    origin: Any, count: Any, offset: Any, owner: Any,
) -> float:  # fmt: skip
    """Signed distance to the gel's surface, mm: below 0 in the gel, within 0.1 mm right."""
    half = 0.5 * size
    box = max(abs(x - half[0]) - half[0], abs(y - half[1]) - half[1], abs(z - half[2]) - half[2])
    if box > 0.1:
        return box
    i = int((x - origin[0]) / CELL_MM)
    j = int((y - origin[1]) / CELL_MM)
    k = int((z - origin[2]) / CELL_MM)
    if not (0 <= i < count[0] and 0 <= j < count[1] and 0 <= k < count[2]):
        return box
    cell = (i * count[1] + j) * count[2] + k
    lumen = 0.1
    for n in range(offset[cell], offset[cell + 1]):
        p = owner[n]
        if p >= len(pieces):
            ball = balls[p - len(pieces)]
            away = math.sqrt((x - ball[0]) ** 2 + (y - ball[1]) ** 2 + (z - ball[2]) ** 2)
            lumen = min(lumen, away - ball[3])
            continue
        ax, ay, az = pieces[p, 0], pieces[p, 1], pieces[p, 2]
        dx, dy, dz = pieces[p, 3] - ax, pieces[p, 4] - ay, pieces[p, 5] - az
        t = ((x - ax) * dx + (y - ay) * dy + (z - az) * dz) / (dx * dx + dy * dy + dz * dz)
        t = min(1.0, max(0.0, t))
        away = math.sqrt((x - ax - t * dx) ** 2 + (y - ay - t * dy) ** 2 + (z - az - t * dz) ** 2)
        lumen = min(lumen, away - radius[p, 0] - t * (radius[p, 1] - radius[p, 0]))
    return max(box, -lumen)


@numba.njit(cache=True)
def _share(above: float, below: float) -> float:
    """Share of a straight way on which a distance, linear between its ends, is below 0."""
    if above < 0.0 and below < 0.0:
        return 1.0
    if above >= 0.0 and below >= 0.0:
        return 0.0
    return min(above, below) / (min(above, below) - max(above, below))


@numba.njit(cache=True, parallel=True)
def _render(
    nx: int, ny: int, nz: int, voxel: Any, to_part: Any, size: Any, pieces: Any, radius: Any,
    balls: Any, origin: Any, count: Any, offset: Any, owner: Any, numbers: Any,
    looks: int,
    seed: Any,
) -> Any:  # fmt: skip
    out = np.empty((nz, ny, nx), np.uint16)
    counts, attenuation, liquid, noise = numbers
    for row in numba.prange(ny):
        for column in range(nx):
            passed = 1.0
            state = _mixed(seed * np.uint64(0x2545F4914F6CDD1D) + np.uint64(row * nx + column))
            above = 0.0
            for level in range(nz + 1):
                # A beam is thin; along it a voxel counts with its share of gel.
                sx, sy, sz = column * voxel[0], row * voxel[1], (level - 0.5) * voxel[2]
                x = to_part[0, 0] * sx + to_part[0, 1] * sy + to_part[0, 2] * sz + to_part[0, 3]
                y = to_part[1, 0] * sx + to_part[1, 1] * sy + to_part[1, 2] * sz + to_part[1, 3]
                z = to_part[2, 0] * sx + to_part[2, 1] * sy + to_part[2, 2] * sz + to_part[2, 3]
                below = _gel(
                    x, y, z, size, pieces, radius, balls, origin, count, offset, owner
                )  # fmt: skip
                upper, above = above, below
                if level == 0:
                    continue
                gel = _share(upper, below)
                scatter = gel + (1.0 - gel) * liquid
                lost = math.exp(-attenuation * scatter * voxel[2])
                mean = noise + counts * scatter * passed * lost
                passed *= lost * lost
                product = 1.0
                for _ in range(looks):
                    state += np.uint64(1)
                    product *= ((_mixed(state) >> np.uint64(11)) + np.uint64(1)) * 2.0**-53
                out[level - 1, row, column] = np.uint16(
                    min(65535.0, -mean * math.log(product) / looks + 0.5)
                )
    return out


#: Sides of a vessel's polygon; of the circle's area.
SIDES = 96


@dataclass(frozen=True)
class Design:
    """Vessels in a block.

    Attributes
    ----------
    name : str
    size : (3,) float64, mm
        The block, from the origin.
    node : (m, 3) float64, mm
    vessel : (n, 2) int64
        First and last node of each.
    radius : (n,) float64, mm
    marks : (k, 3) float64, mm
        Centres of half balls cut out of the block's faces.
    mark_mm : float
        Their radius.
    """

    name: str
    size: FloatArray
    node: FloatArray
    vessel: IntArray
    radius: FloatArray
    marks: FloatArray
    mark_mm: float = 0.3

    def mesh(self) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """The block without its lumens and marks."""
        round_up = np.sqrt(np.pi / (0.5 * SIDES * np.sin(2 * np.pi / SIDES)))
        cuts = []
        for (a, b), r in zip(self.node[self.vessel], self.radius, strict=True):
            cuts.append(_rod(a, b, r * round_up))
        last = {int(k): float(r) for v, r in zip(self.vessel, self.radius, strict=True) for k in v}
        for v, r in zip(self.vessel, self.radius, strict=True):
            for k in v.tolist():
                last[k] = max(last[k], float(r))
        cuts += [_ball(self.node[k], r) for k, r in last.items()]
        cuts += [_ball(mark, self.mark_mm) for mark in self.marks]
        block = manifold3d.Manifold.cube(self.size.tolist())
        mesh = manifold3d.Manifold.batch_boolean([block, *cuts], manifold3d.OpType.Subtract)
        found = mesh.to_mesh()
        return np.asarray(found.vert_properties[:, :3]), np.asarray(found.tri_verts, np.int32)

    def csv(self) -> str:
        """The network in the product's own format, a piece a row."""
        head = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
        rows = [head]
        for k, ((a, b), r) in enumerate(zip(self.vessel.tolist(), self.radius, strict=True)):
            xyz = ",".join(
                f"{value!r}" for value in (*self.node[a].tolist(), *self.node[b].tolist())
            )
            rows.append(f"{k},{a},{b},{xyz},{float(r)!r},{float(r)!r},artery,0")
        return "\n".join(rows) + "\n"


@dataclass(frozen=True)
class Truth:
    """What the scan was made from; only checkers read it.

    Attributes
    ----------
    scan_from_part : (4, 4) float64
    stretch : (3,) float64
        Size of the print over the design's.
    """

    scan_from_part: FloatArray
    stretch: FloatArray


@dataclass(frozen=True)
class Setting:
    """How a phantom lies and is scanned.

    Attributes
    ----------
    shape : (nx, ny, nz)
    voxel_mm : (dx, dy, dz)
        Geometric.
    turn_deg, tilt_x_deg, tilt_y_deg : float, °
    shift_mm : (3,) float
        Of the part's middle from the field's.
    stretch : (3,) float
    light : Light
    """

    shape: tuple[int, int, int] = (1000, 500, 250)
    voxel_mm: tuple[float, float, float] = (0.015, 0.015, 0.012)
    turn_deg: float = 12.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0
    shift_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stretch: tuple[float, float, float] = (0.98, 0.978, 0.975)
    light: Light = field(default_factory=Light)


def planar(*, marked: bool = True) -> Design:
    """Four parallel channels of 0.4 to 0.8 mm between two manifolds; without marks symmetric."""
    size = np.array([11.0, 5.6, 2.2])
    ys, ends = [0.9, 2.1, 2.8, 3.4, 4.8], (1.6, 9.4)
    if not marked:
        ys = [0.9, 2.0, 2.8, 3.6, 4.7]
    node = [(0.0, 2.8)] + [(ends[0], y) for y in ys] + [(ends[1], y) for y in ys] + [(11.0, 2.8)]
    vessel = [(0, 3), (3, 2), (2, 1), (3, 4), (4, 5), (1, 6), (2, 7), (4, 9), (5, 10)]
    vessel += [(6, 7), (7, 8), (10, 9), (9, 8), (8, 11)]
    channels = [0.2, 0.25, 0.3, 0.4] if marked else [0.25, 0.3, 0.3, 0.25]
    radius = np.array([0.3] * 5 + channels + [0.3] * 5)
    marks = [(1.0, 0.8, 2.2), (10.0, 0.8, 2.2), (1.0, 4.8, 2.2)] if marked else []
    return Design(
        "planar" if marked else "symmetric",
        size,
        np.array([(x, y, 1.1) for x, y in node]),
        np.array(vessel),
        radius,
        np.array(marks, dtype=float).reshape(-1, 3),
    )


def branched() -> Design:
    """A tree of 15 vessels through the whole depth of a block 2.6 mm high."""
    size = np.array([11.0, 5.6, 2.6])
    node = [(0.0, 2.8, 1.3), (2.2, 2.8, 1.3)]
    vessel, radius = [(0, 1)], [0.4]
    for k, (y, z) in enumerate([(1.5, 0.8), (4.1, 1.8)]):
        node.append((4.6, y, z))
        vessel.append((1, 2 + k))
        radius.append(0.32)
    for k, (y, z) in enumerate([(0.7, 0.6), (2.2, 1.5), (3.3, 1.2), (4.9, 2.0)]):
        node.append((7.4, y, z))
        vessel.append((2 + k // 2, 4 + k))
        radius.append(0.25)
    tips = [
        (0.5, 1.6),
        (1.3, 0.5),
        (1.9, 2.0),
        (2.7, 0.7),
        (3.0, 1.9),
        (3.9, 0.6),
        (4.5, 1.3),
        (5.1, 2.1),
    ]
    for k, (y, z) in enumerate(tips):
        node.append((11.0, y, z))
        vessel.append((4 + k // 2, 8 + k))
        radius.append(0.2)
    return Design(
        "branched",
        size,
        np.array(node),
        np.array(vessel),
        np.array(radius),
        np.array([(1.0, 0.8, 2.6), (1.0, 4.9, 2.6), (9.8, 0.8, 2.6)]),
    )


def scan_of(design: Design, setting: Setting, seed: int) -> tuple[NDArray[np.uint16], Truth]:
    """The scan, (nz, ny, nx), depth downwards, and what it was made from."""
    truth = _truth(design, setting)
    pieces, radius = _pieces(design)
    balls = np.column_stack([design.marks, np.full(len(design.marks), design.mark_mm)])
    cells = cells_of(design.size, pieces, radius, balls)
    to_part: FloatArray = np.linalg.inv(truth.scan_from_part).astype(np.float64)
    volume = render(
        setting.shape, setting.voxel_mm, to_part, design.size, pieces, radius, balls,
        cells, setting.light, seed,
    )  # fmt: skip
    return volume, truth


def _truth(design: Design, setting: Setting) -> Truth:
    turn, x, y = np.deg2rad([setting.turn_deg, setting.tilt_x_deg, setting.tilt_y_deg])
    about_z = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    # The scan's depth runs down, the part's z up.
    rotation = np.diag([1.0, -1.0, -1.0]) @ about_y @ about_x @ about_z
    stretch = np.array(setting.stretch)
    field_mm = (np.array(setting.shape) - 1) * setting.voxel_mm
    middle = field_mm / 2 + np.array(setting.shift_mm)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * stretch
    matrix[:3, 3] = middle - matrix[:3, :3] @ (design.size / 2)
    return Truth(matrix, stretch)


def _pieces(design: Design) -> tuple[FloatArray, FloatArray]:
    """Straight pieces (n, 6) with a radius at either end (n, 2)."""
    ends = design.node[design.vessel].reshape(-1, 6)
    return ends, np.column_stack([design.radius, design.radius])


def moved(setting: Setting, **changes: Any) -> Setting:
    """The setting with some of it changed."""
    return replace(setting, **changes)


def _rod(a: FloatArray, b: FloatArray, r: float) -> manifold3d.Manifold:
    axis = (b - a) / np.linalg.norm(b - a)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    frame = np.column_stack([side, np.cross(axis, side), axis, a])
    return manifold3d.Manifold.cylinder(float(np.linalg.norm(b - a)), r, r, SIDES).transform(frame)


def _ball(centre: FloatArray, r: float) -> manifold3d.Manifold:
    return manifold3d.Manifold.sphere(r, SIDES).translate(centre.tolist())

"""Read an STL or 3MF file; compute its expected union and how far facets lie off the exact tubes.

Without product code. The files are read from their bytes; equal float32 corners are one vertex. The
reference volume is that of a union of round-ended cones, by Monte-Carlo sampling.
"""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.meshes import _FACET
from benchmarks.checkers.networks import Pieces

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Found:
    """Topology and volume of a file.

    ``paired``: every edge is walked exactly once in each direction, so the surface is closed and
    oriented; ``volume`` above 0 says outwards. ``handles`` by Euler, summed over ``bodies``.
    ``collapsed``: triangles with two equal corners. ``split``: vertices at which two fans touch.
    """

    triangles: int
    paired: bool
    volume: float
    bodies: int
    handles: int
    collapsed: int
    split: int
    unit: str | None

    @property
    def closed(self) -> bool:
        """Closed, oriented outwards, nothing collapsed, no vertex shared by two fans."""
        return self.paired and self.volume > 0.0 and not self.collapsed and not self.split


def read_corners(path: Path) -> tuple[FloatArray, str | None]:
    """Corners of all triangles (f, 3, 3) as float32 values, and the unit where the file says it."""
    if path.suffix == ".3mf":
        return _read_3mf(path)
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    if len(data) != 84 + count * _FACET.itemsize:
        raise ValueError(f"{path} isn't a binary STL: {len(data)} bytes for {count} facets")
    return np.frombuffer(data, _FACET, offset=84)["corner"].astype(np.float64), None


def _read_3mf(path: Path) -> tuple[FloatArray, str | None]:
    with zipfile.ZipFile(path) as packed:
        text = packed.read("3D/3dmodel.model").decode()
    unit = re.search(r'<model[^>]*unit="(\w+)"', text)
    corners = []
    for mesh in re.findall(r"<mesh>(.*?)</mesh>", text, re.S):
        places = np.array(
            re.findall(r'<vertex x="(\S+)" y="(\S+)" z="(\S+)"', mesh), dtype=np.float64
        )
        faces = np.array(
            re.findall(r'<triangle v1="(\d+)" v2="(\d+)" v3="(\d+)"', mesh), dtype=np.int64
        )
        corners.append(places.astype(np.float32).astype(np.float64)[faces])
    return np.concatenate(corners), unit.group(1) if unit else None


def check_file(path: Path) -> Found:
    """Read ``path`` and look at its edges, fans and volume."""
    corners, unit = read_corners(path)
    flat = np.ascontiguousarray(corners.reshape(-1, 3).astype(np.float32) + np.float32(0))
    order = np.lexsort(flat.T)
    fresh = np.any(flat[order][1:] != flat[order][:-1], axis=1)
    index = np.empty(len(flat), dtype=np.int64)
    index[order] = np.concatenate([[0], np.cumsum(fresh)])
    faces = index.reshape(-1, 3)
    a, b, c = faces.T
    collapsed = int(np.sum((a == b) | (b == c) | (c == a)))
    middle = corners.mean(axis=(0, 1))
    one, two, three = (corners[:, k] - middle for k in range(3))
    volume = float(np.einsum("ij,ij->i", one, np.cross(two, three)).sum() / 6.0)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    size = int(faces.max()) + 1
    out, back = np.sort(tail * size + head), np.sort(head * size + tail)
    paired = bool(np.array_equal(out, back) and np.all(np.diff(out) > 0))
    if not paired:
        return Found(len(faces), False, volume, 0, 0, collapsed, 0, unit)
    bodies, _ = _groups(tail, head, size)
    fans = _fans(faces, size)
    euler = fans - len(faces) // 2
    split = fans - size
    # A vertex shared by two fans joins bodies that only touch; count them as the fans do.
    return Found(len(faces), True, volume, bodies, bodies - euler // 2, collapsed, split, unit)


def _fans(faces: IntArray, size: int) -> int:
    """Closed fans of corners: corners of neighbouring faces that share an edge and a vertex."""
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    corner = np.arange(len(tail))
    after = corner + 1 - 3 * (corner % 3 == 2)
    here, there = np.argsort(tail * size + head), np.argsort(head * size + tail)
    # The half-edge from u to v lies against the one from v to u: u is its tail and that one's head.
    return _groups(here, after[there], len(tail))[0]


def _groups(one: IntArray, two: IntArray, count: int) -> tuple[int, IntArray]:
    joined = coo_array((np.ones(len(one), np.int8), (one, two)), shape=(count, count))
    number, label = connected_components(joined, directed=False)
    return int(number), label


def capsule_union_volume(
    start: FloatArray,
    end: FloatArray,
    radius0: FloatArray,
    radius1: FloatArray,
    samples: int = 2_000_000,
    seed: int = 0,
) -> tuple[float, float]:
    """Volume of the union of cones with half balls at their ends, and its standard error, mm³.

    Each solid is sampled evenly within; a point that lies in m of them counts 1/m (so the sum
    over all solids counts every place once). No grid, no mesh.
    """
    rng = np.random.default_rng(seed)
    axis = end - start
    length = np.linalg.norm(axis, axis=1)
    axis = axis / length[:, None]
    cone = np.pi * length * (radius0**2 + radius0 * radius1 + radius1**2) / 3.0
    volume = cone + 2.0 / 3.0 * np.pi * (radius0**3 + radius1**3)
    share = np.maximum(64, np.ceil(samples * volume / volume.sum())).astype(np.int64)
    which = np.repeat(np.arange(len(start)), share)
    points = _inside(rng, which, (start, axis, length, radius0, radius1))
    count = _multiplicity(points, start, axis, length, radius0, radius1)
    weight = 1.0 / np.maximum(count, 1)
    mean = np.bincount(which, weight) / share
    square = np.bincount(which, weight**2) / share - mean**2
    total = float((volume * mean).sum())
    error = float(np.sqrt((volume**2 * np.maximum(square, 0.0) / share).sum()))
    return total, error


def _inside(rng: np.random.Generator, which: IntArray, solid: tuple[FloatArray, ...]) -> FloatArray:
    """Points even within their solids: drawn in the cylinder around, kept when inside."""
    start, axis, length, radius0, radius1 = (part[which] for part in solid)
    wide = np.maximum(radius0, radius1)
    helper = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(axis, first)
    points = np.empty_like(start)
    left = np.arange(len(which))
    while len(left):
        s = rng.uniform(-radius0[left], length[left] + radius1[left])
        angle, away = (
            rng.uniform(0, 2 * np.pi, len(left)),
            wide[left] * np.sqrt(rng.random(len(left))),
        )
        slope = (radius1[left] - radius0[left]) / length[left]
        room = radius0[left] + slope * np.clip(s, 0, length[left])
        over = np.maximum(np.maximum(-s, s - length[left]), 0.0)
        kept = away**2 + over**2 <= room**2
        at = left[kept]
        points[at] = (
            start[at]
            + s[kept, None] * axis[at]
            + (away * np.cos(angle))[kept, None] * first[at]
            + (away * np.sin(angle))[kept, None] * second[at]
        )
        left = left[~kept]
    return points


def _multiplicity(
    points: FloatArray,
    start: FloatArray,
    axis: FloatArray,
    length: FloatArray,
    radius0: FloatArray,
    radius1: FloatArray,
) -> IntArray:
    """In how many of the solids each point lies; solids are cut short so that a ball holds each."""
    piece = np.maximum(1, np.ceil(length / (2.0 * np.maximum(radius0, radius1)))).astype(np.int64)
    solid = np.repeat(np.arange(len(start)), piece)
    number = np.arange(len(solid)) - np.repeat(np.cumsum(piece) - piece, piece)
    half = 0.5 * (length / piece)[solid]
    middle = start[solid] + ((2 * number + 1) * half)[:, None] * axis[solid]
    reach = half + np.maximum(radius0, radius1)[solid]
    count = np.zeros(len(points), dtype=np.int64)
    tree = cKDTree(points)
    for begin in range(0, len(solid), 2000):
        part = slice(begin, begin + 2000)
        near = tree.query_ball_point(middle[part], reach[part])
        sizes = np.array([len(one) for one in near])
        if sizes.sum() == 0:
            continue
        at = np.concatenate([np.asarray(one, dtype=np.int64) for one in near])
        k = np.repeat(solid[part], sizes)
        here = np.repeat(number[part], sizes)
        s = np.einsum("ij,ij->i", points[at] - start[k], axis[k])
        # Each place along the axis belongs to one piece, so that none counts a point twice.
        own = np.clip(s * (piece / length)[k], 0, piece[k] - 1).astype(np.int64) == here
        foot = np.clip(s, 0.0, length[k])
        gap = np.linalg.norm(points[at] - start[k] - foot[:, None] * axis[k], axis=1)
        radius = radius0[k] + (radius1 - radius0)[k] * foot / length[k]
        np.add.at(count, at[own & (gap <= radius)], 1)
    return count


def facet_deviations(
    corners: FloatArray, pieces: Pieces, samples: int = 40_000, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Distances of points on triangles (f, 3, 3) from the exact surface, (n,), mm; and over radius.

    Half of the points are even in area, so that tubes count; half are one each of faces drawn at
    random, so that junctions and ends, which have most faces, count. The radius is that of the
    solid that the point belongs to.
    """
    rng = np.random.default_rng(seed)
    a, b, c = (corners[:, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = np.r_[
        rng.choice(len(corners), samples // 2, p=area / area.sum()),
        rng.integers(0, len(corners), samples - samples // 2),
    ]
    one, two = rng.random((2, samples))
    turned = one + two > 1.0
    one, two = np.where(turned, 1.0 - one, one)[:, None], np.where(turned, 1.0 - two, two)[:, None]
    points = a[face] + one * (b - a)[face] + two * (c - a)[face]
    gap, radius = np.empty(samples), np.empty(samples)
    _nearest(points, pieces.start, pieces.end, np.ascontiguousarray(pieces.radius), gap, radius)
    return gap, gap / radius


@compiled
def _nearest(
    points: FloatArray,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    gap: FloatArray,
    own: FloatArray,
) -> None:
    for n in range(len(points)):
        best, wide = np.inf, 0.0
        x, y, z = points[n]
        for m in range(len(start)):
            ax, ay, az = (end[m, 0] - start[m, 0], end[m, 1] - start[m, 1], end[m, 2] - start[m, 2])
            px, py, pz = x - start[m, 0], y - start[m, 1], z - start[m, 2]
            along = (px * ax + py * ay + pz * az) / (ax * ax + ay * ay + az * az)
            along = min(1.0, max(0.0, along))
            here = radius[m, 0] + along * (radius[m, 1] - radius[m, 0])
            px, py, pz = px - along * ax, py - along * ay, pz - along * az
            away = np.sqrt(px * px + py * py + pz * pz) - here
            if away < best:
                best, wide = away, here
        gap[n], own[n] = best, wide

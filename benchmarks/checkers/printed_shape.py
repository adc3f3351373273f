"""Deviation of a simulated print from its design, measured on the deposited ink.

The ink that the simulator laid is shrunk as it shrinks after printing, put over the design as well
as a shift can, and held against walls drawn from network.csv: balls swept along straight axes, and
the block around them. Nothing of the product's is used but the simulator's own record of its ink.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
Signed = Callable[[FloatArray], FloatArray]

STEP_MM = 0.04
NEAR_MM = 0.3
"""Surface farther from the design than this is a gap between lines, not a wall."""
BLUR_MM = 0.04
"""Takes gaps between lines away, which are no walls either; flat walls stay where they are, and a
lumen's of 0.4 mm moves by 4 um."""
MOST_POINTS = 100_000


@dataclass(frozen=True)
class Vessels:
    """Straight vessels of a network.csv, and places along their axes.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    radius : (n,) float64, mm
    axis : (m, 3), reach (m,), of (m,)
        Places `STEP_MM` apart, the radius there, and the piece.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray
    axis: FloatArray
    reach: FloatArray
    of: NDArray[np.int64]

    def distance(self, points: FloatArray) -> FloatArray:
        """To the lumens' walls, (k,), mm; negative inside a lumen."""
        away, which = cKDTree(self.axis).query(points, k=12)
        del away
        best = np.full(len(points), np.inf)
        for column in which.T:
            piece = self.of[column]
            way = self.end[piece] - self.start[piece]
            share = ((points - self.start[piece]) * way).sum(axis=1) / (way**2).sum(axis=1)
            foot = self.start[piece] + np.clip(share, 0, 1)[:, None] * way
            best = np.minimum(best, np.linalg.norm(points - foot, axis=1) - self.radius[piece])
        return best


def vessels_of(path: Path) -> Vessels:
    """Read a network.csv in mm."""
    with path.open() as handle:
        rows = list(csv.DictReader(handle))
    ends = [
        np.array([[float(row[f"{axis}{end}"]) for axis in "xyz"] for row in rows]) for end in (0, 1)
    ]
    radius = np.array([(float(r["radius0_mm"]) + float(r["radius1_mm"])) / 2 for r in rows])
    axis, of = [], []
    for k, (a, b) in enumerate(zip(*ends, strict=True)):
        count = max(2, int(np.linalg.norm(b - a) / STEP_MM) + 1)
        axis.append(a + np.linspace(0, 1, count)[:, None] * (b - a))
        of += [k] * count
    number = np.array(of)
    return Vessels(ends[0], ends[1], radius, np.concatenate(axis), radius[number], number)


@dataclass(frozen=True)
class Ink:
    """Voxels of ink, in the part's frame, after shrinking.

    Attributes
    ----------
    filled : (nz, ny, nx) float32, 0 to 1
    origin_mm, step_mm : (3,) float64, mm
        x, y, z of the first voxel's centre, and from voxel to voxel.
    """

    filled: NDArray[np.float32]
    origin_mm: FloatArray
    step_mm: FloatArray

    def at(self, points: FloatArray) -> FloatArray:
        """Share of ink at places (k, 3); nothing outside the grid."""
        index = ((points - self.origin_mm) / self.step_mm)[:, ::-1].T
        return np.asarray(map_coordinates(self.filled, index, order=1, cval=0.0))

    def surface(self) -> FloatArray:
        """Places where ink ends, between voxels, (k, 3), mm; at most `MOST_POINTS`."""
        found = []
        smooth = gaussian_filter(self.filled, BLUR_MM / self.step_mm[::-1], mode="constant")
        for axis in range(3):
            low = [slice(None)] * 3
            high = [slice(None)] * 3
            low[2 - axis], high[2 - axis] = slice(None, -1), slice(1, None)
            a, b = smooth[tuple(low)] - 0.5, smooth[tuple(high)] - 0.5
            where = np.argwhere((a < 0) != (b < 0))
            share = a[tuple(where.T)] / (a[tuple(where.T)] - b[tuple(where.T)])
            place = where[:, ::-1].astype(np.float64)
            place[:, axis] += share
            found.append(self.origin_mm + place * self.step_mm)
        points = np.concatenate(found)
        chosen = np.random.default_rng(0).permutation(len(points))[:MOST_POINTS]
        return points[np.sort(chosen)]


@dataclass(frozen=True)
class Shape:
    """A print against its design.

    Attributes
    ----------
    median_um, p95_um : float, µm
        Of the unsigned distance of its walls to the designed ones, after the best shift: of the
        surface that lies within `NEAR_MM`.
    dropped_percent : float, %
        Of its surface that lies farther, and isn't in `median_um` and `p95_um`.
    diameter_um : float, µm
        Mean size of the error of the lumens' equal-area diameters.
    offset_um : float, µm
        Mean distance of their centroids from the designed axes.
    lumens : int
        Measured.
    """

    median_um: float
    p95_um: float
    dropped_percent: float
    diameter_um: float
    offset_um: float
    lumens: int


def measure(ink: Ink, vessels: Vessels, block_mm: FloatArray | None) -> Shape:
    """Hold ink against a design.

    Parameters
    ----------
    ink : Ink
    vessels : Vessels
    block_mm : (2, 3) or None, mm
        The body around the lumens, where ink is the body; None where ink is the lumens.
    """
    points = ink.surface()
    signed = _signed(vessels, block_mm)
    shift = _shift(points, signed)
    distance = np.abs(signed(points + shift))
    off = distance[distance < NEAR_MM]
    wide, aside = _sections(ink, vessels, shift, block_mm is not None)
    return Shape(
        median_um=1e3 * float(np.median(off)),
        p95_um=1e3 * float(np.percentile(off, 95)),
        dropped_percent=100 * (1 - len(off) / len(distance)),
        diameter_um=1e3 * float(np.mean(np.abs(wide))),
        offset_um=1e3 * float(np.mean(aside)),
        lumens=len(wide),
    )


def _signed(vessels: Vessels, block_mm: FloatArray | None) -> Signed:
    """Distance to the printed body's walls, below 0 within it."""

    def signed(points: FloatArray) -> FloatArray:
        lumen = vessels.distance(points)
        if block_mm is None:
            return lumen
        low, high = block_mm
        return np.maximum(np.maximum(low - points, points - high).max(axis=1), -lumen)

    return signed


def _shift(points: FloatArray, signed: Signed) -> FloatArray:
    """By least squares over walls within `NEAR_MM`, (3,), mm."""
    some = points[:: max(1, len(points) // 20_000)]
    shift = np.zeros(3)
    for _ in range(6):
        here = some + shift
        value = signed(here)
        slope = np.stack(
            [(signed(here + 1e-3 * e) - signed(here - 1e-3 * e)) / 2e-3 for e in np.eye(3)], axis=1
        )
        kept = np.abs(value) < NEAR_MM
        shift = shift - np.linalg.lstsq(slope[kept], value[kept], rcond=None)[0]
    return shift


def _sections(
    ink: Ink, vessels: Vessels, shift: FloatArray, body: bool
) -> tuple[FloatArray, FloatArray]:
    """Error of the diameter, and offset of the centroid, of each lumen with room to itself, mm."""
    tree = cKDTree(vessels.axis)
    length = np.linalg.norm(vessels.end - vessels.start, axis=1)
    wide, aside = [], []
    for k in np.flatnonzero(length > 5 * vessels.radius):
        way = (vessels.end[k] - vessels.start[k]) / length[k]
        found = []
        for share in np.linspace(0.3, 0.7, 9):
            middle = vessels.start[k] + share * (vessels.end[k] - vessels.start[k])
            near = tree.query_ball_point(middle, 2 * vessels.radius[k] + vessels.radius.max())
            other = np.array([n for n in near if vessels.of[n] != k], dtype=np.int64)
            gap = np.linalg.norm(vessels.axis[other] - middle, axis=1) - vessels.reach[other]
            if len(gap) == 0 or gap.min() > 1.7 * vessels.radius[k]:
                found.append(_section(ink, middle - shift, way, vessels.radius[k], body))
        if found:
            wide.append(np.mean([d for d, _ in found]) - 2 * vessels.radius[k])
            aside.append(float(np.linalg.norm(np.mean([c for _, c in found], axis=0))))
    return np.array(wide), np.array(aside)


def _section(
    ink: Ink, middle: FloatArray, way: FloatArray, radius: float, body: bool
) -> tuple[float, FloatArray]:
    """Equal-area diameter and centroid (in the plane) of what is free (or filled) in a disc."""
    one = np.cross(way, [0.0, 0.0, 1.0] if abs(way[2]) < 0.9 else [1.0, 0.0, 0.0])
    one /= np.linalg.norm(one)
    two = np.cross(way, one)
    grid = np.linspace(-1.5, 1.5, 121) * radius
    a, b = (g.ravel() for g in np.meshgrid(grid, grid))
    inside = a**2 + b**2 <= (1.5 * radius) ** 2
    a, b = a[inside], b[inside]
    share = ink.at(middle + a[:, None] * one + b[:, None] * two)
    share = 1 - share if body else share
    total = float(share.sum())
    area = total * float(grid[1] - grid[0]) ** 2
    centre = np.array([(share * a).sum(), (share * b).sum()]) / max(total, 1e-9)
    return 2 * np.sqrt(area / np.pi), centre

"""Search candidate poses over all orientations, for scans of a part or a piece."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numba
import numpy as np
from scipy.spatial.transform import Rotation

from kernels import jit, pjit
from kernels.arrays import Float32Array, FloatArray
from registration.alignment.distance import DistanceGrid, ModelSurface
from registration.alignment.fit import Fit


@dataclass(frozen=True)
class AlignmentOptions:
    """Options and limits of an alignment.

    Attributes
    ----------
    cover : int
        Orientations tried, spread evenly over all there are.
    descents : int
        The best of these, improved.
    orientations, places : int
        Distinct ones kept of these, and places tried of each where the view is partial.
    coarse_points, fine_points, contest_points : int
        Surface points used while searching, for the final fits, and to compare poses.
    depth_span_mm : float, mm
        The part's depth in view from which the depth scale is fitted; below, a scale can't be
        told from an error of the refractive index.
    distinct_mm : float, mm
        Poses that move no point of the part by more than this are the same.
    ambiguous_below : float
        Lead (see `contest`) of the pose over the best wrong one below which it is ambiguous.
    """

    cover: int = 1500
    descents: int = 160
    orientations: int = 16
    places: int = 4
    coarse_points: int = 1500
    fine_points: int = 20_000
    contest_points: int = 60_000
    depth_span_mm: float = 2.0
    distinct_mm: float = 0.3
    ambiguous_below: float = 1.5


_PHI, _PSI = np.sqrt(2.0), 1.533751168755204288118041


def spread_rotations(count: int) -> FloatArray:
    """Return `count` rotation matrices, (count, 3, 3), spread evenly over SO(3).

    Super-Fibonacci spirals (Alexa 2022, 10.1109/CVPR52688.2022.00811, eq. 6).
    """
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2 * np.pi * s / _PHI, 2 * np.pi * s / _PSI
    quaternions = np.stack(
        [
            inner * np.sin(alpha),
            inner * np.cos(alpha),
            outer * np.sin(beta),
            outer * np.cos(beta),
        ],
        axis=1,
    )
    return np.asarray(Rotation.from_quat(quaternions).as_matrix())


@jit
def _distance(
    grid: Float32Array, origin: FloatArray, step: float, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Trilinear distance and its gradient; beyond the grid its value at the border, and on."""
    nz, ny, nx = grid.shape
    a = (x - origin[0]) / step
    b = (y - origin[1]) / step
    c = (z - origin[2]) / step
    ca = min(max(a, 0.0), nx - 1.000001)
    cb = min(max(b, 0.0), ny - 1.000001)
    cc = min(max(c, 0.0), nz - 1.000001)
    i, j, k = int(ca), int(cb), int(cc)
    u, v, w = ca - i, cb - j, cc - k
    g000, g001 = grid[k, j, i], grid[k, j, i + 1]
    g010, g011 = grid[k, j + 1, i], grid[k, j + 1, i + 1]
    g100, g101 = grid[k + 1, j, i], grid[k + 1, j, i + 1]
    g110, g111 = grid[k + 1, j + 1, i], grid[k + 1, j + 1, i + 1]
    x00, x01 = g000 + u * (g001 - g000), g010 + u * (g011 - g010)
    x10, x11 = g100 + u * (g101 - g100), g110 + u * (g111 - g110)
    y0, y1 = x00 + v * (x01 - x00), x10 + v * (x11 - x10)
    value = y0 + w * (y1 - y0)
    gx = (1 - w) * ((1 - v) * (g001 - g000) + v * (g011 - g010)) + w * (
        (1 - v) * (g101 - g100) + v * (g111 - g110)
    )
    gy = (1 - w) * (x01 - x00) + w * (x11 - x10)
    gz = y1 - y0
    ox, oy, oz = (a - ca) * step, (b - cb) * step, (c - cc) * step
    outside = math.sqrt(ox * ox + oy * oy + oz * oz)
    if outside > 0.0:
        return value + outside, ox / outside, oy / outside, oz / outside
    return value, gx / step, gy / step, gz / step


@pjit
def losses(
    grid: Float32Array,
    origin: FloatArray,
    step: float,
    points: FloatArray,
    poses: FloatArray,
    scale: float,
) -> FloatArray:
    """Mean robust loss d²/(d² + scale²) of each pose (n, 3, 4) over the points."""
    out = np.empty(len(poses))
    for s in numba.prange(len(poses)):
        pose = poses[s]
        total = 0.0
        for i in range(len(points)):
            p = points[i]
            x = pose[0, 0] * p[0] + pose[0, 1] * p[1] + pose[0, 2] * p[2] + pose[0, 3]
            y = pose[1, 0] * p[0] + pose[1, 1] * p[1] + pose[1, 2] * p[2] + pose[1, 3]
            z = pose[2, 0] * p[0] + pose[2, 1] * p[1] + pose[2, 2] * p[2] + pose[2, 3]
            d = _distance(grid, origin, step, x, y, z)[0]
            total += d * d / (d * d + scale * scale)
        out[s] = total / len(points)
    return out


@pjit
def descend(
    grid: Float32Array,
    origin: FloatArray,
    step: float,
    points: FloatArray,
    poses: FloatArray,
    scales: FloatArray,
    steps: int,
) -> FloatArray:
    """Poses (n, 3, 4) after `steps` of robust Gauss-Newton at each of the loss's `scales`, mm.

    Points should be centred about their mean. The loss is Geman & McClure's (1987).
    """
    out = poses.copy()
    for s in numba.prange(len(poses)):
        pose = out[s]
        for k in range(len(scales)):
            scale = scales[k]
            for _ in range(steps):
                normal = np.zeros((6, 6))
                right = np.zeros(6)
                row = np.empty(6)
                for i in range(len(points)):
                    p = points[i]
                    rx = pose[0, 0] * p[0] + pose[0, 1] * p[1] + pose[0, 2] * p[2]
                    ry = pose[1, 0] * p[0] + pose[1, 1] * p[1] + pose[1, 2] * p[2]
                    rz = pose[2, 0] * p[0] + pose[2, 1] * p[1] + pose[2, 2] * p[2]
                    d, gx, gy, gz = _distance(
                        grid, origin, step, rx + pose[0, 3], ry + pose[1, 3], rz + pose[2, 3]
                    )
                    weight = (scale * scale / (scale * scale + d * d)) ** 2
                    row[0], row[1], row[2] = ry * gz - rz * gy, rz * gx - rx * gz, rx * gy - ry * gx
                    row[3], row[4], row[5] = gx, gy, gz
                    for a in range(6):
                        right[a] -= weight * row[a] * d
                        for b in range(a + 1):
                            normal[a, b] += weight * row[a] * row[b]
                for a in range(6):
                    normal[a, a] = normal[a, a] * 1.001 + 1e-9
                _solve(normal, right)
                _advance(pose, right)
                if np.abs(right).max() < 1e-5:
                    break
    return out


@jit
def _solve(normal: FloatArray, right: FloatArray) -> None:
    """Put into ``right`` the solution of a system by Cholesky's factors of its lower triangle.

    Numba's own solver takes five seconds to compile.
    """
    for a in range(6):
        for b in range(a + 1):
            left = normal[a, b]
            for c in range(b):
                left -= normal[a, c] * normal[b, c]
            normal[a, b] = left / normal[b, b] if b < a else math.sqrt(left)
    for a in range(6):
        for b in range(a):
            right[a] -= normal[a, b] * right[b]
        right[a] /= normal[a, a]
    for a in range(5, -1, -1):
        for b in range(a + 1, 6):
            right[a] -= normal[b, a] * right[b]
        right[a] /= normal[a, a]


@jit
def _advance(pose: FloatArray, delta: FloatArray) -> None:
    """Turn a pose by the rotation vector ``delta[:3]`` (Rodrigues) and shift it."""
    x, y, z = delta[0], delta[1], delta[2]
    angle = math.sqrt(x * x + y * y + z * z)
    if angle > 0.3:
        # A longer turn than the linearisation bears.
        x, y, z, angle = x * 0.3 / angle, y * 0.3 / angle, z * 0.3 / angle, 0.3
    a = math.sin(angle) / angle if angle > 1e-12 else 1.0
    b = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-12 else 0.5
    rest = 1.0 - b * angle * angle
    for c in range(3):
        px, py, pz = pose[0, c], pose[1, c], pose[2, c]
        along = b * (x * px + y * py + z * pz)
        pose[0, c] = rest * px + a * (y * pz - z * py) + along * x
        pose[1, c] = rest * py + a * (z * px - x * pz) + along * y
        pose[2, c] = rest * pz + a * (x * py - y * px) + along * z
    for c in range(3):
        pose[c, 3] += delta[3 + c]


THIN, MEDIUM = 160, 450
"""Points for the first look at all orientations, and for the first descent."""
SLACK_MM = 0.5
"""A view is partial along an axis where the part is longer by more than this."""
SLIDE_MM = 0.4
"""Step of places tried along what the part is longer by: within the catch of a lumen."""
WIDE, CLOSE_MM = 0.06, (0.4, 0.15)
"""Scales of the robust loss: the first as a share of the part's diagonal, then mm."""
MOST_PLACES = 400
"""Places tried of one orientation."""


@dataclass(frozen=True)
class Search:
    """What every search of a pose needs.

    Attributes
    ----------
    surface : ModelSurface
    grid : DistanceGrid
        Of the surface.
    options : AlignmentOptions
    """

    surface: ModelSurface
    grid: DistanceGrid
    options: AlignmentOptions

    def poses(self, points: FloatArray, most: int) -> list[Fit]:
        """Return at most `most` distinct poses of points (n, 3), the lowest robust loss first."""
        middle = points.mean(axis=0)
        centred = np.ascontiguousarray(points - middle)
        turned = self._oriented(centred)
        placed = np.concatenate([self._placed(centred, pose) for pose in turned])
        poses = self._descend(centred, placed, CLOSE_MM, 18)
        score = self._losses(centred, poses, CLOSE_MM[-1])
        centre = self.surface.bounds.mean(axis=0)
        ranked = poses[np.argsort(score, kind="stable")]
        kept = ranked[_distinct(ranked, centred, self.options.distinct_mm, most)]
        return [
            Fit(pose[:, :3], pose[:, 3] - pose[:, :3] @ middle, np.ones(3), centre) for pose in kept
        ]

    def _oriented(self, centred: FloatArray) -> FloatArray:
        """Distinct poses after a first descent from all orientations, (k, 3, 4), best first."""
        wide = WIDE * float(np.linalg.norm(np.ptp(self.surface.bounds, axis=0)))
        few = _some(centred, THIN)
        starts = self._starts(few)
        score = self._losses(few, starts, wide)
        chosen = starts[np.argsort(score, kind="stable")[: self.options.descents]]
        more = _some(centred, MEDIUM)
        poses = self._descend(more, chosen, (wide, CLOSE_MM[0]), 8)
        ranked = poses[np.argsort(self._losses(more, poses, CLOSE_MM[0]), kind="stable")]
        return np.asarray(ranked[_distinct(ranked, few, 2 * SLIDE_MM, self.options.orientations)])

    def _starts(self, few: FloatArray) -> FloatArray:
        """The best place of each orientation, box against box, (n, 3, 4)."""
        turns = spread_rotations(self.options.cover)
        low, high = self.surface.bounds
        turned = np.sort(few @ turns.transpose(0, 2, 1), axis=1)
        rim = max(1, len(few) // 50)
        ends = low - turned[:, rim], high - turned[:, -1 - rim]
        starts = []
        for share in product((0.0, 0.5, 1.0), repeat=3):
            pose = np.empty((len(turns), 3, 4))
            pose[:, :, :3] = turns
            pose[:, :, 3] = ends[0] + np.array(share) * (ends[1] - ends[0])
            wanted = ((np.array(share) == 0.5) | (ends[1] - ends[0] > 2 * SLACK_MM)).all(axis=1)
            starts.append(pose[wanted])
        return np.concatenate(starts)

    def _placed(self, centred: FloatArray, pose: FloatArray) -> FloatArray:
        """The pose, and where else along what isn't in view it may belong, (k, 3, 4)."""
        there = centred @ pose[:, :3].T + pose[:, 3]
        seen = np.percentile(there, (1, 99), axis=0)
        ends = (
            np.minimum(self.surface.bounds - seen, 0)[0],
            np.maximum(self.surface.bounds - seen, 0)[1],
        )
        slack = ends[1] - ends[0] > SLACK_MM
        if not slack.any():
            return pose[None]
        count = np.where(slack, np.ceil((ends[1] - ends[0]) / SLIDE_MM), 1).astype(int)
        count = np.maximum(
            1,
            np.floor(count * min(1.0, (MOST_PLACES / count.prod()) ** (1 / slack.sum()))).astype(
                int
            ),
        )
        steps = [
            np.linspace(a, b, n) if n > 1 else np.zeros(1)
            for a, b, n in zip(*ends, count, strict=True)
        ]
        shifts = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        places = np.repeat(pose[None], len(shifts) + 1, axis=0)
        places[1:, :, 3] += shifts
        score = self._losses(_some(centred, MEDIUM), places, CLOSE_MM[0] / 2)
        best = np.argsort(score[1:], kind="stable")[: self.options.places] + 1
        return np.asarray(places[np.concatenate([[0], best])])

    def _descend(
        self, points: FloatArray, poses: FloatArray, scales: tuple[float, ...], steps: int
    ) -> FloatArray:
        grid = self.grid
        where = (grid.values, grid.origin_mm, grid.step_mm)
        return np.asarray(
            descend(*where, points, np.ascontiguousarray(poses), np.array(scales), steps)
        )

    def _losses(self, points: FloatArray, poses: FloatArray, scale: float) -> FloatArray:
        grid = self.grid
        where = (grid.values, grid.origin_mm, grid.step_mm)
        return np.asarray(losses(*where, points, np.ascontiguousarray(poses), scale))


def _some(points: FloatArray, most: int) -> FloatArray:
    """At most `most` of points that lie in no order, spread evenly."""
    every = max(1, len(points) // most)
    return np.ascontiguousarray(points[::every][:most])


def _distinct(poses: FloatArray, points: FloatArray, apart_mm: float, most: int) -> list[int]:
    """Numbers of the first `most` poses that move no point nearer than `apart_mm` to another's."""
    corners = np.array(list(product(*np.percentile(points, (0, 100), axis=0).T)))
    there = corners @ poses[:, :, :3].transpose(0, 2, 1) + poses[:, None, :, 3]
    kept: list[int] = []
    for k in range(len(poses)):
        away = np.linalg.norm(there[kept] - there[k], axis=2).max(axis=1)
        if (away > apart_mm).all():
            kept.append(k)
        if len(kept) == most:
            break
    return kept

"""Coarse alignment: fit many candidate poses to the design's grid of signed distances at once."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import jit, pjit
from kernels.arrays import FloatArray

Grid = NDArray[np.float32]


@jit
def _distance(
    grid: Grid, origin: FloatArray, step: float, x: float, y: float, z: float
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
    grid: Grid, origin: FloatArray, step: float, points: FloatArray, poses: FloatArray, scale: float
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
    grid: Grid,
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

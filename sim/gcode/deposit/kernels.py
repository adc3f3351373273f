"""Number unbroken written paths of motion blocks; paint lines and strands in voxels (compiled)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray

ByteArray = NDArray[np.uint8]

STRAIGHT = 0.7
"""Cosine of the turn beyond which a move without plunger is a hop, not part of a line."""
SUPERSAMPLE = 2
"""Fine pixels per voxel edge when layers are painted."""


@jit
def writing_runs(
    length: FloatArray, plunger: FloatArray, move: FloatArray, gap_limit: float
) -> IntArray:
    """Number the unbroken stretches of writing; -1 for blocks that don't write.

    A moving block writes when the plunger advances in it. A short moving block in which no
    whole plunger step fell belongs to the stretch when it goes on in nearly the same direction
    and writing goes on after it within `gap_limit` (mm); a sharp turn without plunger is a hop to
    the next line. Retraction ends a stretch, and so does a longer move without plunger.
    """
    n = len(length)
    run = np.full(n, -1, dtype=np.int64)
    count = 0
    is_open = False
    gap = 0.0
    gap_start = -1
    last = 0
    for i in range(n):
        if length[i] <= 1e-9:
            if plunger[i] < 0.0:
                is_open = False
            continue
        if plunger[i] < 0.0:
            is_open = False
        elif plunger[i] > 0.0:
            if is_open and gap_start >= 0:
                for j in range(gap_start, i):
                    if length[j] > 1e-9:
                        run[j] = count - 1
            elif not is_open:
                count += 1
            run[i] = count - 1
            is_open, gap, gap_start = True, 0.0, -1
            last = i
        elif is_open:
            gap += length[i]
            if gap_start < 0:
                gap_start = i
            ahead = 0.0
            for c in range(3):
                ahead += move[i, c] * move[last, c]
            if gap > gap_limit or ahead < STRAIGHT * length[i] * length[last]:
                is_open, gap, gap_start = False, 0.0, -1
            last = i
        if not is_open:
            gap, gap_start = 0.0, -1
    return run


@jit
def _row_span(
    x0: float, y0: float, x1: float, y1: float, r: float, y: float
) -> tuple[float, float]:
    """Where the row at height `y` crosses the capsule of radius `r`; (1, 0) when it doesn't.

    The capsule is convex, so the span is the hull of what its discs and its flanks give.
    """
    low, high = np.inf, -np.inf
    for cx, cy in ((x0, y0), (x1, y1)):
        rest = r * r - (y - cy) ** 2
        if rest >= 0.0:
            half = np.sqrt(rest)
            low, high = min(low, cx - half), max(high, cx + half)
    dx, dy = x1 - x0, y1 - y0
    length = np.sqrt(dx * dx + dy * dy)
    if length > 0.0:
        nx, ny = -dy / length * r, dx / length * r
        for side in (-1.0, 1.0):
            ya, yb = y0 + side * ny, y1 + side * ny
            if ya != yb and (ya - y) * (yb - y) <= 0.0:
                x = x0 + side * nx + (y - ya) / (yb - ya) * dx
                low, high = min(low, x), max(high, x)
    if low > high:
        return 1.0, 0.0
    return low, high


@pjit
def paint_layers(
    segments: FloatArray,
    radius: FloatArray,
    first: IntArray,
    origin: FloatArray,
    voxel: float,
    shape: tuple[int, int],
) -> ByteArray:
    """Plan view of each layer: share of every pixel that ink covers, 0..255.

    ``segments`` (n, 4) are x0, y0, x1, y1 ordered by layer; layer ``k`` owns
    ``first[k]:first[k + 1]``. A line is a capsule of `radius`; lines of a layer are united.
    """
    layers = len(first) - 1
    ny, nx = shape
    out = np.zeros((layers, ny, nx), dtype=np.uint8)
    fine = voxel / SUPERSAMPLE
    left = origin[0] - voxel / 2 + fine / 2
    bottom = origin[1] - voxel / 2 + fine / 2
    for layer in numba.prange(layers):
        mask = np.zeros((ny * SUPERSAMPLE, nx * SUPERSAMPLE), dtype=np.bool_)
        for s in range(first[layer], first[layer + 1]):
            x0, y0, x1, y1 = segments[s]
            r = radius[s]
            row0 = max(0, int(np.ceil((min(y0, y1) - r - bottom) / fine)))
            row1 = min(ny * SUPERSAMPLE - 1, int(np.floor((max(y0, y1) + r - bottom) / fine)))
            for row in range(row0, row1 + 1):
                low, high = _row_span(x0, y0, x1, y1, r, bottom + row * fine)
                if low > high:
                    continue
                # A hair wider than exact, so that lines laid edge to edge leave no seam.
                a = max(0, int(np.ceil((low - left) / fine - 1e-6)))
                b = min(nx * SUPERSAMPLE - 1, int(np.floor((high - left) / fine + 1e-6)))
                mask[row, a : b + 1] = True
        for y in range(ny):
            for x in range(nx):
                covered = 0
                for j in range(SUPERSAMPLE):
                    for i in range(SUPERSAMPLE):
                        covered += mask[y * SUPERSAMPLE + j, x * SUPERSAMPLE + i]
                out[layer, y, x] = (covered * 255) // (SUPERSAMPLE * SUPERSAMPLE)
    return out


@pjit
def stack_layers(
    plan: ByteArray, low: FloatArray, high: FloatArray, z0: float, voxel: float, slices: int
) -> ByteArray:
    """Spread each layer's plan over the slices between its `low` and `high` face."""
    layers, ny, nx = plan.shape
    out = np.zeros((slices, ny, nx), dtype=np.uint8)
    for k in numba.prange(slices):
        bottom = z0 + (k - 0.5) * voxel
        total = np.zeros((ny, nx), dtype=np.float32)
        touched = False
        for layer in range(layers):
            overlap = min(high[layer], bottom + voxel) - max(low[layer], bottom)
            if overlap <= 0.0:
                continue
            touched = True
            weight = np.float32(overlap / voxel)
            for y in range(ny):
                for x in range(nx):
                    total[y, x] += weight * plan[layer, y, x]
        if touched:
            for y in range(ny):
                for x in range(nx):
                    out[k, y, x] = np.uint8(min(255.0, total[y, x] + 0.5))
    return out


@pjit
def paint_filaments(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    origin: FloatArray,
    voxel: float,
    shape: tuple[int, int, int],
) -> ByteArray:
    """Round filaments around their axes; a voxel's share from its distance to the surface."""
    nz, ny, nx = shape
    out = np.zeros((nz, ny, nx), dtype=np.uint8)
    for k in numba.prange(nz):
        z = origin[2] + k * voxel
        for s in range(len(radius)):
            reach = radius[s] + voxel
            z0, z1 = start[s, 2], end[s, 2]
            if z < min(z0, z1) - reach or z > max(z0, z1) + reach:
                continue
            dx, dy, dz = end[s, 0] - start[s, 0], end[s, 1] - start[s, 1], z1 - z0
            squared = dx * dx + dy * dy + dz * dz
            t0, t1 = 0.0, 1.0
            if abs(dz) > 1e-9:
                # Only this part of the axis comes near the slice.
                ta, tb = (z - reach - z0) / dz, (z + reach - z0) / dz
                t0, t1 = max(0.0, min(ta, tb)), min(1.0, max(ta, tb))
            xa, xb = start[s, 0] + t0 * dx, start[s, 0] + t1 * dx
            ya, yb = start[s, 1] + t0 * dy, start[s, 1] + t1 * dy
            x_low = max(0, int(np.ceil((min(xa, xb) - reach - origin[0]) / voxel)))
            x_high = min(nx - 1, int(np.floor((max(xa, xb) + reach - origin[0]) / voxel)))
            y_low = max(0, int(np.ceil((min(ya, yb) - reach - origin[1]) / voxel)))
            y_high = min(ny - 1, int(np.floor((max(ya, yb) + reach - origin[1]) / voxel)))
            for y in range(y_low, y_high + 1):
                py = origin[1] + y * voxel - start[s, 1]
                for x in range(x_low, x_high + 1):
                    px = origin[0] + x * voxel - start[s, 0]
                    pz = z - z0
                    t = (px * dx + py * dy + pz * dz) / squared if squared > 0.0 else 0.0
                    t = min(1.0, max(0.0, t))
                    ex, ey, ez = px - t * dx, py - t * dy, pz - t * dz
                    inside = 0.5 + (radius[s] - np.sqrt(ex * ex + ey * ey + ez * ez)) / voxel
                    if inside > 0.0:
                        value = np.uint8(255.0 * min(1.0, inside) + 0.5)
                        out[k, y, x] = max(out[k, y, x], value)
    return out

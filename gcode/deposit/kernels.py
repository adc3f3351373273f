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
PARALLEL = 1e-12
"""A change along a line below it is the rounding of none, mm."""


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
def band_span(start: float, step: float, low: float, high: float) -> tuple[float, float]:
    """Return the ends of the t at which start + t step lies in [low, high]; (inf, -inf) if none."""
    if abs(step) > PARALLEL:
        ta, tb = (low - start) / step, (high - start) / step
        return min(ta, tb), max(ta, tb)
    if low <= start <= high:
        return -np.inf, np.inf
    return np.inf, -np.inf


@jit
def pixels_between(
    low: float, high: float, origin: float, pixel: float, count: int
) -> tuple[int, int]:
    """Return the first and last of a row's pixels whose middles lie in [low, high]."""
    first, last = int(np.ceil((low - origin) / pixel)), int(np.floor((high - origin) / pixel))
    return max(0, first), min(count - 1, last)


@jit
def stadium_span(
    px: float,
    py: float,
    dx: float,
    dy: float,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    half: float,
) -> tuple[float, float]:
    """Between which t the point p + t d is in a stadium; (1, 0) where never.

    A stadium is convex, so the span is the hull of what its two discs and its rectangle give.
    """
    square = dx * dx + dy * dy
    # Both ends on one side of the ray, and farther than half the width: most lines are.
    side0 = dx * (y0 - py) - dy * (x0 - px)
    side1 = dx * (y1 - py) - dy * (x1 - px)
    if side0 * side1 > 0.0 and min(side0 * side0, side1 * side1) > half * half * square:
        return 1.0, 0.0
    low, high = np.inf, -np.inf
    for cx, cy in ((x0 - px, y0 - py), (x1 - px, y1 - py)):
        along = dx * cx + dy * cy
        rest = along * along - square * (cx * cx + cy * cy - half * half)
        if rest >= 0.0:
            root = np.sqrt(rest)
            low, high = min(low, (along - root) / square), max(high, (along + root) / square)
    lx, ly = x1 - x0, y1 - y0
    length = np.sqrt(lx * lx + ly * ly)
    if length > 0.0:
        lx, ly = lx / length, ly / length
        s, ds = (px - x0) * lx + (py - y0) * ly, dx * lx + dy * ly
        n, dn = (py - y0) * lx - (px - x0) * ly, dy * lx - dx * ly
        s0, s1 = band_span(s, ds, 0.0, length)
        n0, n1 = band_span(n, dn, -half, half)
        a0, a1 = max(s0, n0), min(s1, n1)
        if a0 <= a1:
            low, high = min(low, a0), max(high, a1)
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
            below, above = min(y0, y1) - r, max(y0, y1) + r
            row0, row1 = pixels_between(below, above, bottom, fine, ny * SUPERSAMPLE)
            for row in range(row0, row1 + 1):
                low, high = stadium_span(0.0, bottom + row * fine, 1.0, 0.0, x0, y0, x1, y1, r)
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
            dx, dy, dz = end[s, 0] - start[s, 0], end[s, 1] - start[s, 1], z1 - z0
            squared = dx * dx + dy * dy + dz * dz
            # Only this part of the axis comes near the slice.
            t0, t1 = band_span(z0, dz, z - reach, z + reach)
            t0, t1 = max(0.0, t0), min(1.0, t1)
            if t0 > t1:
                continue
            xa, xb = start[s, 0] + t0 * dx, start[s, 0] + t1 * dx
            ya, yb = start[s, 1] + t0 * dy, start[s, 1] + t1 * dy
            left, right = min(xa, xb) - reach, max(xa, xb) + reach
            x_low, x_high = pixels_between(left, right, origin[0], voxel, nx)
            front, back = min(ya, yb) - reach, max(ya, yb) + reach
            y_low, y_high = pixels_between(front, back, origin[1], voxel, ny)
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

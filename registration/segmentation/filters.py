"""Kernels on scan volumes: bin, smooth, interpolate coarse fields, normalise between levels."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import jit, pjit
from kernels.arrays import Float32Array, IntArray
from registration.scan import Scan
from registration.segmentation.volume import Volume

Weights = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]

_PER_DB = np.float32(math.log(10.0) / 10.0)


@pjit
def bin_mean(raw: NDArray[np.generic], bins: tuple[int, int, int], decibel: bool) -> Float32Array:
    """Mean linear intensity of blocks of ``bins`` (z, y, x) voxels.

    Intensities in dB become linear before they are averaged; a rest at the end is dropped.
    """
    bz, by, bx = bins
    nz, ny, nx = raw.shape[0] // bz, raw.shape[1] // by, raw.shape[2] // bx
    out = np.empty((nz, ny, nx), dtype=np.float32)
    share = np.float32(1.0 / (bz * by * bx))
    for z in numba.prange(nz):
        row = np.empty(nx, dtype=np.float32)
        for y in range(ny):
            row[:] = 0.0
            for k in range(z * bz, (z + 1) * bz):
                for j in range(y * by, (y + 1) * by):
                    for x in range(nx):
                        for i in range(x * bx, (x + 1) * bx):
                            value = np.float32(raw[k, j, i])
                            if decibel:
                                value = np.exp(value * _PER_DB)
                            row[x] += value
            for x in range(nx):
                out[z, y, x] = row[x] * share
    return out


@pjit
def bin_counts(
    raw: NDArray[np.generic],
    bins: tuple[int, int, int],
    intensities: NDArray[np.float32],
    first: int,
) -> Float32Array:
    """Mean of what counts stand for, over blocks of ``bins`` (z, y, x) voxels.

    ``intensities[count - first]`` is that of a count.
    """
    bz, by, bx = bins
    nz, ny, nx = raw.shape[0] // bz, raw.shape[1] // by, raw.shape[2] // bx
    out = np.empty((nz, ny, nx), dtype=np.float32)
    share = np.float32(1.0 / (bz * by * bx))
    for z in numba.prange(nz):
        row = np.empty(nx, dtype=np.float32)
        for y in range(ny):
            row[:] = 0.0
            for k in range(z * bz, (z + 1) * bz):
                for j in range(y * by, (y + 1) * by):
                    for x in range(nx):
                        total = np.float32(0.0)
                        for i in range(x * bx, (x + 1) * bx):
                            total += intensities[np.int64(raw[k, j, i]) - first]
                        row[x] += total
            for x in range(nx):
                out[z, y, x] = row[x] * share
    return out


def binned(scan: Scan, bins: tuple[int, int, int]) -> Float32Array:
    """Mean linear intensity of blocks of ``bins`` (z, y, x) voxels, read slab by slab."""
    counts = [size // of for size, of in zip(scan.volume.shape, bins, strict=True)]
    out = np.empty(counts, dtype=np.float32)
    table = scan.intensities
    least = int(np.iinfo(scan.volume.dtype.name).min) if table is not None else 0
    for slab in scan.slabs(bins):
        if table is None:
            out[slab.where] = bin_mean(slab.voxels, bins, scan.scale == "db")
        else:
            out[slab.where] = bin_counts(slab.voxels, bins, table, least)
    return out


@pjit
def mean_where(
    values: Float32Array, mask: NDArray[np.bool_], bins: tuple[int, int, int]
) -> Float32Array:
    """Sum of `values` where `mask` holds, over blocks of ``bins`` voxels, by the block's size."""
    bz, by, bx = bins
    nz, ny, nx = values.shape[0] // bz, values.shape[1] // by, values.shape[2] // bx
    out = np.empty((nz, ny, nx), dtype=np.float32)
    share = np.float32(1.0 / (bz * by * bx))
    for z in numba.prange(nz):
        for y in range(ny):
            for x in range(nx):
                total = np.float32(0.0)
                for k in range(z * bz, (z + 1) * bz):
                    for j in range(y * by, (y + 1) * by):
                        for i in range(x * bx, (x + 1) * bx):
                            if mask[k, j, i]:
                                total += values[k, j, i]
                out[z, y, x] = total * share
    return out


def gaussian_weights(sigma_voxels: float) -> NDArray[np.float32]:
    """Weights of a Gaussian out to three standard deviations, summing to 1."""
    reach = max(1, math.ceil(3 * sigma_voxels))
    offsets = np.arange(-reach, reach + 1)
    if sigma_voxels <= 0:
        return np.asarray(offsets == 0, dtype=np.float32)
    weights = np.exp(-0.5 * (offsets / sigma_voxels) ** 2)
    return np.asarray(weights / weights.sum(), dtype=np.float32)


@jit
def _add_taps(
    out: NDArray[np.float32],
    first: NDArray[np.generic],
    second: NDArray[np.generic],
    third: NDArray[np.generic],
    weights: NDArray[np.float32],
    tap: int,
) -> None:
    """Add three weighted rows to one, in their order: a third of the loads and stores."""
    a, b, c = weights[tap], weights[tap + 1], weights[tap + 2]
    for x in range(len(out)):
        out[x] = ((out[x] + a * np.float32(first[x])) + b * np.float32(second[x])) + c * np.float32(
            third[x]
        )


@jit
def _add_tap(out: NDArray[np.float32], row: NDArray[np.generic], weight: np.float32) -> None:
    for x in range(len(out)):
        out[x] += weight * np.float32(row[x])


@jit
def _row(plane: NDArray[np.generic], y: int) -> NDArray[np.generic]:
    """Row `y` of a plane, the nearest beyond its edges."""
    return plane[min(max(y, 0), len(plane) - 1)]


@jit
def _smooth_plane(
    plane: NDArray[np.generic],
    out: Float32Array,
    weights: tuple[NDArray[np.float32], NDArray[np.float32]],
    row: NDArray[np.float32],
) -> None:
    """Smooth one plane along y and x into `out`; `row` is room for a row and its margins."""
    wy, wx = weights
    ny, nx = plane.shape
    ty, tx = len(wy), len(wx)
    ry, rx = ty // 2, tx // 2
    inner = row[rx : rx + nx]
    for y in range(ny):
        row[:] = 0.0
        for j in range(0, ty - 2, 3):
            top = y - ry + j
            a, b, c = _row(plane, top), _row(plane, top + 1), _row(plane, top + 2)
            _add_taps(inner, a, b, c, wy, j)
        for j in range(ty - ty % 3, ty):
            _add_tap(inner, _row(plane, y - ry + j), wy[j])
        for i in range(rx):
            row[i], row[nx + rx + i] = row[rx], row[nx + rx - 1]
        line = out[y]
        line[:] = 0.0
        for i in range(0, tx - 2, 3):
            _add_taps(
                line, row[i : i + nx], row[i + 1 : i + 1 + nx], row[i + 2 : i + 2 + nx], wx, i
            )
        for i in range(tx - tx % 3, tx):
            _add_tap(line, row[i : i + nx], wx[i])


def smooth(
    values: NDArray[np.generic],
    out: Volume,
    weights: Weights,
    rounding: float,
) -> None:
    """Separable Gaussian (weights along z, y, x) into `out`, nearest value beyond the edges.

    `rounding` is 0.5 when `out` holds whole numbers.
    """
    _smooth(values, out, weights, rounding, -(-len(values) // numba.get_num_threads()))


@pjit
def _smooth(
    values: NDArray[np.generic], out: Volume, weights: Weights, rounding: float, thick: int
) -> None:
    """Smooth slabs of `thick` planes; a thread keeps those that the slab's next one needs."""
    wz, wy, wx = weights
    nz, ny, nx = values.shape
    taps, rz = len(wz), len(wz) // 2
    for slab in numba.prange((nz + thick - 1) // thick):
        first = int(np.int64(slab)) * thick  # numba's own index is unsigned
        last = min(nz, first + thick)
        planes = np.empty((taps, ny, nx), dtype=np.float32)
        row, line = np.empty(nx + 2 * (len(wx) // 2), np.float32), np.empty(nx, np.float32)
        known = max(0, first - rz)
        for z in range(first, last):
            while known < min(nz, z + rz + 1):
                _smooth_plane(values[known], planes[known % taps], (wy, wx), row)
                known += 1
            for y in range(ny):
                line[:] = np.float32(rounding)
                for k in range(0, taps - 2, 3):
                    a = planes[min(max(z - rz + k, 0), nz - 1) % taps, y]
                    b = planes[min(max(z - rz + k + 1, 0), nz - 1) % taps, y]
                    c = planes[min(max(z - rz + k + 2, 0), nz - 1) % taps, y]
                    _add_taps(line, a, b, c, wz, k)
                for k in range(taps - taps % 3, taps):
                    _add_tap(line, planes[min(max(z - rz + k, 0), nz - 1) % taps, y], wz[k])
                for x in range(nx):
                    out[z, y, x] = line[x]


@jit
def interpolate_coarse(
    field: Float32Array, factor: tuple[int, int, int], z: int, y: int, x: int
) -> float:
    """A coarse field (block centres at every `factor`-th voxel) at a voxel, trilinear."""
    mz, my, mx = field.shape
    c = min(max((z + 0.5) / factor[0] - 0.5, 0.0), mz - 1.0)
    b = min(max((y + 0.5) / factor[1] - 0.5, 0.0), my - 1.0)
    a = min(max((x + 0.5) / factor[2] - 0.5, 0.0), mx - 1.0)
    k, j, i = int(c), int(b), int(a)
    k1, j1, i1 = min(k + 1, mz - 1), min(j + 1, my - 1), min(i + 1, mx - 1)
    w, v, u = c - k, b - j, a - i
    near = field[k, j, i] * (1 - u) + field[k, j, i1] * u
    far = field[k, j1, i] * (1 - u) + field[k, j1, i1] * u
    top = near * (1 - v) + far * v
    near = field[k1, j, i] * (1 - u) + field[k1, j, i1] * u
    far = field[k1, j1, i] * (1 - u) + field[k1, j1, i1] * u
    return float(top * (1 - w) + (near * (1 - v) + far * v) * w)


@jit
def _steps(count: int, size: int, factor: int) -> tuple[IntArray, Float32Array]:
    """Along an axis of `size` voxels: the coarse one below each, and how far it is to the next.

    `count` coarse ones, block centres at every `factor`-th voxel, as in `interpolate_coarse`.
    """
    index, part = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.float32)
    for voxel in range(size):
        at = min(max((voxel + 0.5) / factor - 0.5, 0.0), count - 1.0)
        index[voxel] = min(int(at), max(count - 2, 0))
        part[voxel] = at - index[voxel]
    return index, part


@jit
def _row_between(
    field: Float32Array, k: int, w: np.float32, j: int, v: np.float32, out: Float32Array
) -> None:
    """A coarse field's row between its layers `k`, and between its rows `j`, into `out`."""
    up, ahead = min(k + 1, field.shape[0] - 1), min(j + 1, field.shape[1] - 1)
    one = np.float32(1.0)
    for i in range(field.shape[2]):
        near = field[k, j, i] * (one - v) + field[k, ahead, i] * v
        far = field[up, j, i] * (one - v) + field[up, ahead, i] * v
        out[i] = near * (one - w) + far * w


@pjit
def normalise(
    values: Float32Array, low: Float32Array, high: Float32Array, factor: tuple[int, int, int]
) -> None:
    """Map in place what is `low` to 0 and `high` to 1; both at every `factor`-th voxel."""
    nz, ny, nx = values.shape
    mz, my, mx = low.shape
    layer, w = _steps(mz, nz, factor[0])
    line, v = _steps(my, ny, factor[1])
    place, u = _steps(mx, nx, factor[2])
    for z in numba.prange(nz):
        lows, highs = np.empty(mx + 1, np.float32), np.empty(mx + 1, np.float32)
        for y in range(ny):
            _row_between(low, layer[z], w[z], line[y], v[y], lows)
            _row_between(high, layer[z], w[z], line[y], v[y], highs)
            lows[mx], highs[mx] = lows[mx - 1], highs[mx - 1]
            for x in range(nx):
                i, part = place[x], u[x]
                at = lows[i] + part * (lows[i + 1] - lows[i])
                span = max(highs[i] + part * (highs[i + 1] - highs[i]) - at, np.float32(0.1))
                values[z, y, x] = (values[z, y, x] - at) / span


@pjit
def times_level(
    values: Float32Array, level: Float32Array, factor: tuple[int, int, int]
) -> Float32Array:
    """Product of a volume and a level, at least 0.1, known at every `factor`-th voxel."""
    nz, ny, nx = values.shape
    mz, my, mx = level.shape
    layer, w = _steps(mz, nz, factor[0])
    line, v = _steps(my, ny, factor[1])
    place, u = _steps(mx, nx, factor[2])
    out = np.empty_like(values)
    for z in numba.prange(nz):
        row = np.empty(mx + 1, np.float32)
        for y in range(ny):
            _row_between(level, layer[z], w[z], line[y], v[y], row)
            row[mx] = row[mx - 1]
            for x in range(nx):
                i = place[x]
                at = max(row[i] + u[x] * (row[i + 1] - row[i]), np.float32(0.1))
                out[z, y, x] = values[z, y, x] / (np.float32(1.0) / at)
    return out


@pjit
def near_in_depth(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Voxels with one of `mask` at most `reach` above or below them."""
    nz, ny, nx = mask.shape
    out = np.zeros((nz, ny, nx), dtype=np.bool_)
    for y in numba.prange(ny):
        last = np.full(nx, -reach - 1)
        for z in range(nz):
            for x in range(nx):
                if mask[z, y, x]:
                    last[x] = z
                out[z, y, x] = z - last[x] <= reach
        last[:] = nz + reach + 1
        for step in range(nz):
            z = nz - 1 - step
            for x in range(nx):
                if mask[z, y, x]:
                    last[x] = z
                out[z, y, x] |= last[x] - z <= reach
    return out

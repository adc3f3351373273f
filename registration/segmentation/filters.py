"""Kernels on whole volumes: binning, smoothing, local levels."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import jit, pjit
from registration.scan import Scan
from registration.segmentation.volume import Volume

FloatArray = NDArray[np.float64]
FloatVolume = NDArray[np.float32]
Weights = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]

_CHUNK = 12
"""Planes a thread smooths at a time: enough to spread the halo, little enough for memory."""


@pjit
def bin_mean(
    raw: NDArray[np.generic], bins: tuple[int, int, int], decibel: bool, offset: float
) -> FloatVolume:
    """Mean linear intensity of blocks of ``bins`` (z, y, x) voxels, less `offset`.

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
                                value = np.float32(10.0) ** (value * np.float32(0.1))
                            row[x] += value
            for x in range(nx):
                out[z, y, x] = row[x] * share - np.float32(offset)
    return out


@pjit
def bin_counts(
    raw: NDArray[np.generic],
    bins: tuple[int, int, int],
    intensities: NDArray[np.float32],
    first: int,
) -> FloatVolume:
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


def binned(scan: Scan, bins: tuple[int, int, int]) -> FloatVolume:
    """Mean linear intensity of blocks of ``bins`` (z, y, x) voxels, read slab by slab."""
    counts = [size // of for size, of in zip(scan.volume.shape, bins, strict=True)]
    out = np.empty(counts, dtype=np.float32)
    table = scan.intensities
    least = int(np.iinfo(scan.volume.dtype.name).min) if table is not None else 0
    for slab in scan.slabs(bins):
        if table is None:
            out[slab.where] = bin_mean(slab.voxels, bins, scan.scale == "db", 0.0)
        else:
            out[slab.where] = bin_counts(slab.voxels, bins, table, least)
    return out


@pjit
def mean_where(
    values: FloatVolume, mask: NDArray[np.bool_], bins: tuple[int, int, int]
) -> FloatVolume:
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


@pjit
def smooth(
    values: NDArray[np.generic],
    out: Volume,
    weights: Weights,
    rounding: float,
) -> None:
    """Separable Gaussian (weights along z, y, x) into `out`, nearest value beyond the edges.

    `rounding` is 0.5 when `out` holds whole numbers.
    """
    wz, wy, wx = weights
    nz, ny, nx = values.shape
    rz, ry, rx = len(wz) // 2, len(wy) // 2, len(wx) // 2
    for chunk in numba.prange((nz + _CHUNK - 1) // _CHUNK):
        first = int(np.int64(chunk)) * _CHUNK  # numba's own index is unsigned
        last = min(nz, first + _CHUNK)
        low, high = max(0, first - rz), min(nz, last + rz)
        planes = np.empty((high - low, ny, nx), dtype=np.float32)
        row = np.empty(nx + 2 * rx, dtype=np.float32)
        for z in range(low, high):
            for y in range(ny):
                row[:] = 0.0
                for j in range(-ry, ry + 1):
                    source = min(max(y + j, 0), ny - 1)
                    weight = wy[j + ry]
                    for x in range(nx):
                        row[x + rx] += weight * np.float32(values[z, source, x])
                for i in range(rx):
                    row[i], row[nx + rx + i] = row[rx], row[nx + rx - 1]
                for x in range(nx):
                    total = np.float32(0.0)
                    for i in range(2 * rx + 1):
                        total += wx[i] * row[x + i]
                    planes[z - low, y, x] = total
        line = np.empty(nx, dtype=np.float32)
        for z in range(first, last):
            for y in range(ny):
                line[:] = np.float32(rounding)
                for k in range(-rz, rz + 1):
                    source = min(max(z + k, 0), nz - 1) - low
                    weight = wz[k + rz]
                    for x in range(nx):
                        line[x] += weight * planes[source, y, x]
                for x in range(nx):
                    out[z, y, x] = line[x]


@jit
def between(field: FloatVolume, factor: tuple[int, int, int], z: int, y: int, x: int) -> float:
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


@pjit
def normalise(
    values: FloatVolume, low: FloatVolume, high: FloatVolume, factor: tuple[int, int, int]
) -> None:
    """Map in place what is `low` to 0 and `high` to 1; both at every `factor`-th voxel."""
    nz, ny, nx = values.shape
    for z in numba.prange(nz):
        for y in range(ny):
            for x in range(nx):
                at = between(low, factor, z, y, x)
                span = max(between(high, factor, z, y, x) - at, 0.1)
                values[z, y, x] = np.float32((values[z, y, x] - at) / span)


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

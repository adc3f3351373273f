"""Kernels of the simulated scanners: blur, sampling, reproducible noise."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import jit, pjit
from kernels.arrays import FloatArray

ByteArray = NDArray[np.uint8]


@jit
def random_bits(key: np.uint64, counter: np.uint64) -> np.uint64:
    """64 random bits for a counter (SplitMix64: Steele et al. 2014, 10.1145/2660193.2660195).

    A counter instead of a running state makes every voxel's noise its own, whatever thread
    computes it.
    """
    z = key + counter * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@jit
def lookup(volume: ByteArray, x: float, y: float, z: float) -> float:
    """Trilinear value at a position in voxels, 0..255; 0 outside."""
    nz, ny, nx = volume.shape
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    if i < 0 or j < 0 or k < 0 or i >= nx - 1 or j >= ny - 1 or k >= nz - 1:
        return 0.0
    u, v, w = x - i, y - j, z - k
    a = volume[k, j, i] * (1 - u) + volume[k, j, i + 1] * u
    b = volume[k, j + 1, i] * (1 - u) + volume[k, j + 1, i + 1] * u
    c = volume[k + 1, j, i] * (1 - u) + volume[k + 1, j, i + 1] * u
    d = volume[k + 1, j + 1, i] * (1 - u) + volume[k + 1, j + 1, i + 1] * u
    return float((a * (1 - v) + b * v) * (1 - w) + (c * (1 - v) + d * v) * w)


def blurred(
    volume: ByteArray, sigma_voxels: tuple[float, float, float]
) -> tuple[ByteArray, FloatArray]:
    """Gaussian blur along (z, y, x), in whole grey values (1/255 is below any noise here).

    The grid grows by the blur's reach. Returns it, and by how many voxels along x, y, z.
    """
    weights = [_weights(sigma) for sigma in sigma_voxels]
    pad = [len(each) // 2 for each in weights]
    wide = np.pad(volume, [(each, each) for each in pad])
    return _blur_z(_blur_yx(wide, weights[1], weights[2]), weights[0]), np.array(pad[::-1], float)


def _weights(sigma: float) -> NDArray[np.float32]:
    reach = max(1, math.ceil(3 * sigma))
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / max(sigma, 1e-6)) ** 2)
    return (weights / weights.sum()).astype(np.float32)


@pjit
def _blur_yx(volume: ByteArray, wy: NDArray[np.float32], wx: NDArray[np.float32]) -> ByteArray:
    nz, ny, nx = volume.shape
    out = np.zeros_like(volume)
    ry, rx = len(wy) // 2, len(wx) // 2
    for k in numba.prange(nz):
        row = np.zeros(nx + 2 * rx, dtype=np.float32)
        for y in range(ny):
            row[:] = 0.0
            for j in range(max(0, y - ry), min(ny, y + ry + 1)):
                weight = wy[j - y + ry]
                for x in range(nx):
                    row[x + rx] += weight * volume[k, j, x]
            for x in range(nx):
                total = np.float32(0.5)
                for i in range(2 * rx + 1):
                    total += wx[i] * row[x + i]
                out[k, y, x] = np.uint8(total)
    return out


@pjit
def _blur_z(volume: ByteArray, wz: NDArray[np.float32]) -> ByteArray:
    nz, ny, nx = volume.shape
    out = np.zeros_like(volume)
    rz = len(wz) // 2
    for k in numba.prange(nz):
        row = np.zeros(nx, dtype=np.float32)
        here = int(np.int64(k))  # numba's own index is unsigned
        for y in range(ny):
            row[:] = 0.5
            for j in range(max(0, here - rz), min(nz, here + rz + 1)):
                weight = wz[j - here + rz]
                for x in range(nx):
                    row[x] += weight * volume[j, y, x]
            for x in range(nx):
                out[k, y, x] = np.uint8(row[x])
    return out


def index_map(pose: FloatArray, origin_mm: FloatArray, voxel_mm: float) -> FloatArray:
    """Scan position (mm) to position in the deposit's voxels: (3, 4), x, y, z."""
    inverse = np.linalg.inv(pose)[:3]
    inverse[:, 3] -= origin_mm
    return np.ascontiguousarray(inverse / voxel_mm)

"""Place the part at random (tilt, turn, shift) in a simulated scan, shrunk by given factors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import jit, pjit
from kernels.arrays import FloatArray
from sim.errors import ScannerError


@dataclass(frozen=True)
class Placing:
    """Ranges from which a placing is drawn uniformly.

    Attributes
    ----------
    tilt_deg : float, degrees
        Largest tilt, about a horizontal axis of any direction.
    rotation_deg : float, degrees
        Largest rotation about the vertical, either way.
    shift_mm : float, mm
        Largest shift along each axis from the middle of the field of view.
    margin_mm : float, mm
        Field of view beyond the part on every side, at least `shift_mm`.
    shrink : (3,) of float
        Size of the part over its size as printed, along the printer's axes.
    """

    tilt_deg: float = 3.0
    rotation_deg: float = 10.0
    shift_mm: float = 0.3
    margin_mm: float = 0.5
    shrink: tuple[float, float, float] = (0.985, 0.985, 0.985)

    def __post_init__(self) -> None:
        check_range("tilt_deg", self.tilt_deg, 0, 45, "degrees")
        check_range("rotation_deg", self.rotation_deg, 0, 180, "degrees")
        if not 0 <= self.shift_mm <= self.margin_mm:
            raise ScannerError(
                f"shift_mm {self.shift_mm:g} exceeds margin_mm {self.margin_mm:g}, so the part "
                "could leave the field of view; raise margin_mm"
            )
        for value in self.shrink:
            check_range("shrink", value, 0.5, 2.0, "(size over size as printed)")


def place(
    bounds: FloatArray, placing: Placing, depth_down: bool, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Lay a part with the given bounds (2, 3), mm, into a field of view that holds it.

    Returns
    -------
    pose : (4, 4) float64
        Printer to scan, shrinkage included.
    field : (3,) float64, mm
        Field of view as x, y, z of the scan.
    """
    azimuth, turn, tilt = rng.uniform(-1.0, 1.0, 3)
    shift = rng.uniform(-1.0, 1.0, 3) * placing.shift_mm
    axis = np.array([np.cos(np.pi * azimuth), np.sin(np.pi * azimuth), 0.0])
    rotation = (
        _rotation(axis, np.deg2rad(placing.tilt_deg) * tilt)
        @ _rotation(np.array([0.0, 0.0, 1.0]), np.deg2rad(placing.rotation_deg) * turn)
        @ (np.diag([1.0, -1.0, -1.0]) if depth_down else np.eye(3))
    )
    linear = rotation @ np.diag(placing.shrink)
    half = np.abs(linear) @ (bounds[1] - bounds[0]) / 2
    field = 2 * (half + placing.margin_mm)
    pose = np.eye(4)
    pose[:3, :3] = linear
    pose[:3, 3] = field / 2 + shift - linear @ bounds.mean(axis=0)
    return pose, field


def voxel_counts(
    field_mm: FloatArray, voxel_mm: tuple[float, float, float]
) -> tuple[int, int, int]:
    """Voxels along z, y, x that cover a field (x, y, z); `voxel_mm` as (dz, dy, dx), geometric."""
    nz, ny, nx = (math.ceil(v) for v in field_mm[::-1] / voxel_mm)
    return nz, ny, nx


def _rotation(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation matrix about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


@dataclass(frozen=True)
class ScannerOutput:
    """A simulated volume, its units, and the truth about it.

    The truth goes into a file of its own, which registration never sees.

    Attributes
    ----------
    volume : (nz, ny, nx) uint16
        Intensity, linear.
    voxel_mm : (dz, dy, dx), mm
        dz counts optical path when `optical_depth` is set.
    refractive_index : float
        Group index of the sample; 1 for X-rays.
    optical_depth : bool
        Whether dz counts optical path.
    modality : "oct" or "microct"
        What is simulated.
    depth_down : bool
        Whether growing depth index goes down into the sample.
    pose_truth : (4, 4) float64
        Affine map from the printer's frame to the scan's (geometric mm, origin at the centre of
        voxel (0, 0, 0)), shrinkage included.
    shrink_truth : (3,) float64
        Size of the scanned part over its size as printed, along the printer's axes.
    """

    volume: NDArray[np.uint16]
    voxel_mm: tuple[float, float, float]
    refractive_index: float
    optical_depth: bool
    modality: Literal["oct", "microct"]
    depth_down: bool
    pose_truth: NDArray[np.float64]
    shrink_truth: NDArray[np.float64]
    scale: Literal["linear"] = "linear"


def check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    """Raise `ScannerError` unless `value` lies in [low, high]."""
    if not low <= value <= high:
        raise ScannerError(f"{name} is {value:g} {unit}; allowed are {low:g} to {high:g} {unit}")


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

"""Synthetic scans of calibration targets, by a device with a known distortion."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from kernels.arrays import FloatArray
from registration import Scan
from registration.devices.optics import Beam, OctCalibration, SampleSurface

FAULT = OctCalibration(
    lateral=((1.02, 0.004), (0.0, 0.985)),
    fan_per_mm=(0.008, -0.005),
    bow_per_mm=(0.003, -0.001, 0.002),
)


def blank(shape: tuple[int, int, int], voxel: tuple[float, float, float]) -> Scan:
    """An empty OCT scan in air (dB, optical depth, index 1)."""
    return Scan(
        np.zeros(shape, np.float32), voxel, 1.0, True, "db", "oct", True, Path("target.oct")
    )


def reflecting(
    scan: Scan,
    fault: OctCalibration,
    height: Callable[[FloatArray, FloatArray], FloatArray],
    bright: Callable[[FloatArray, FloatArray], FloatArray],
    seed: int = 1,
) -> Scan:
    """A scan of one reflecting sheet z = height(x, y), seen through a faulty beam.

    Each A-scan is followed down: a reflection where its true path meets the sheet, 3 voxels wide,
    `bright` dB over noise of 3 dB.
    """
    nz, ny, nx = scan.volume.shape
    dz, dy, dx = scan.voxel_mm
    beam = Beam.of(scan, fault)
    y, x = np.meshgrid(np.arange(ny) * dy, np.arange(nx) * dx, indexing="ij")
    depth = np.full(x.shape, nz * dz / 2)
    for _ in range(30):
        true = beam.to_true(np.column_stack([x.ravel(), y.ravel(), depth.ravel()]))
        off = height(true[:, 0], true[:, 1]) - true[:, 2]
        depth += np.clip(off.reshape(depth.shape), -0.2, 0.2)
    true = beam.to_true(np.column_stack([x.ravel(), y.ravel(), depth.ravel()]))
    level = bright(true[:, 0], true[:, 1]).reshape(depth.shape)
    z = np.arange(nz)[:, None, None]
    peak = level * np.exp(-0.5 * ((z - depth / dz) / 3.0) ** 2)
    noise = np.random.default_rng(seed).normal(0.0, 1.0, scan.volume.shape)
    return replace(scan, volume=(peak + noise).astype(np.float32))


def dots(pitch: float, turn: float) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Dots dimmer by half on a sheet, on a lattice turned by some radians."""

    def bright(x: FloatArray, y: FloatArray) -> FloatArray:
        u = (np.cos(turn) * x + np.sin(turn) * y) / pitch
        v = (-np.sin(turn) * x + np.cos(turn) * y) / pitch
        away = np.hypot(u - np.round(u), v - np.round(v))
        return 40.0 - 20.0 / (1 + np.exp((away - 0.25) / 0.02))

    return bright


def tilted(middle: float, slope_x: float, slope_y: float) -> SampleSurface:
    return SampleSurface(np.zeros(2), np.array([middle, slope_x, slope_y, 0.0, 0.0, 0.0]), 0.0)

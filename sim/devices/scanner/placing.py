"""Place the part at random (tilt, turn, shift) in a simulated scan, shrunk by given factors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

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


@dataclass(frozen=True)
class DrawnPose:
    """Randomly drawn pose.

    Attributes
    ----------
    pose : (4, 4) float64
        Printer to scan, shrinkage included.
    field_mm : (3,) float64, mm
        Field of view as x, y, z of the scan.
    """

    pose: FloatArray
    field_mm: FloatArray


def place(
    bounds: FloatArray, placing: Placing, depth_down: bool, rng: np.random.Generator
) -> DrawnPose:
    """Lay a part with the given bounds (2, 3) into a field of view that holds it."""
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
    return DrawnPose(pose, field)


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


# Data class of a simulated scan: volume, units and true pose.


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
    scale : "linear"
        Of the intensity.
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
    scale: Literal["linear"]
    modality: Literal["oct", "microct"]
    depth_down: bool
    pose_truth: NDArray[np.float64]
    shrink_truth: NDArray[np.float64]


def check_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    """Raise `ScannerError` unless `value` lies in [low, high]."""
    if not low <= value <= high:
        raise ScannerError(f"{name} is {value:g} {unit}; allowed are {low:g} to {high:g} {unit}")

"""Data class of a simulated scan: volume, units and true pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.errors import ScannerError


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

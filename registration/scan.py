"""A scanned volume, which never goes without its units."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Scan:
    """An OCT, micro-CT or confocal volume.

    The scan's frame: origin at the centre of voxel (0, 0, 0); x along the fastest index, y along
    the B-scans, z along the depth index, mm, right-handed as it stands. For OCT z points *down*
    into the sample, so that the part's up is the scan's -z.

    Attributes
    ----------
    volume : (nz, ny, nx), any real dtype
        Intensity.
    voxel_mm : (dz, dy, dx), mm
        Geometric; where `optical_depth` is set, dz still is optical and must be divided by
        `refractive_index` before use.
    refractive_index : float
        Group index of what fills the sample; 1 where light isn't what measured.
    optical_depth : bool
        Whether dz counts optical path.
    scale : "linear" or "db"
        Of the intensity.
    modality : "oct" or "microct" or "confocal"
        What measured.
    depth_down : bool
        Whether growing depth index goes down into the sample.
    came_from : Path
        The file.
    """

    volume: NDArray[np.generic]
    voxel_mm: tuple[float, float, float]
    refractive_index: float
    optical_depth: bool
    scale: Literal["linear", "db"]
    modality: Literal["oct", "microct", "confocal"]
    depth_down: bool
    came_from: Path

    @property
    def geometric_voxel_mm(self) -> tuple[float, float, float]:
        """(dz, dy, dx) with the depth divided by the index where it was optical, mm."""
        dz, dy, dx = self.voxel_mm
        return (dz / self.refractive_index if self.optical_depth else dz, dy, dx)

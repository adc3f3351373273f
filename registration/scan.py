"""Data class of a scanned volume (OCT, micro-CT, confocal), read slab by slab."""

from __future__ import annotations

import mmap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from registration.wall_reference import WallCalibration


@dataclass(frozen=True)
class CountLine:
    """dB of a count: ``db = db_at_zero + count / counts_per_db``."""

    counts_per_db: float
    db_at_zero: float

    @property
    def plain(self) -> bool:
        """Whether counts are dB as they stand."""
        return (self.counts_per_db, self.db_at_zero) == (1.0, 0.0)

    def decibels(self, counts: NDArray[np.generic]) -> NDArray[np.float32]:
        """DB of counts, float32."""
        values = counts.astype(np.float32)
        return np.asarray(values / np.float32(self.counts_per_db) + np.float32(self.db_at_zero))

    def intensities(self, kind: np.dtype[np.generic]) -> NDArray[np.float32]:
        """Linear intensity of every count of an integer `kind`, the lowest first."""
        bounds = np.iinfo(kind.name)
        counts = np.arange(bounds.min, bounds.max + 1)
        return np.asarray(np.float32(10.0) ** (self.decibels(counts) * np.float32(0.1)))


@dataclass(frozen=True)
class Space:
    """The file's own right-handed space, and where the scan's frame lies in it.

    Attributes
    ----------
    name : str
        "LPS" for patient coordinates (x left, y posterior, z superior, as DICOM has them), else
        words of the file's own.
    from_scan : (4, 4) float64, mm
        Takes a point x, y, z of the scan's frame to the space: a rotation and a shift. Depth
        counts as in the file (`Scan.voxel_mm`, optical where `Scan.optical_depth`).
    """

    name: str
    from_scan: NDArray[np.float64]


def drop_pages(volume: NDArray[np.generic]) -> None:
    """Give back what of a file was read: else a copy of it would cost its memory twice."""
    pages = getattr(volume, "_mmap", None)
    if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
        pages.madvise(mmap.MADV_DONTNEED)


SLAB_BYTES = 64 << 20
"""About what a slab holds unless told otherwise."""
Bins = tuple[int, int, int]
Where = tuple[slice, slice, slice]


@dataclass(frozen=True)
class Slab:
    """A part of a volume that fits into memory.

    Attributes
    ----------
    where : (slice, slice, slice)
        Where it lies on the binned grid, as z, y, x: ``out[slab.where] = bin(slab.voxels)``, where
        ``bin`` leaves out a rest that fills no bin.
    voxels : (nz, ny, nx), contiguous, in the machine's byte order
        The scan's voxels there; a view where the scan lies so in memory, else a copy.
    """

    where: Where
    voxels: NDArray[np.generic]


@dataclass(frozen=True)
class Scan:
    """An OCT, micro-CT or confocal volume.

    The scan's frame: origin at the centre of voxel (0, 0, 0); x along the fastest index, y along
    the B-scans, z along the depth index, mm, right-handed as it stands. For OCT z points *down*
    into the sample, so that the part's up is the scan's -z.

    Attributes
    ----------
    volume : (nz, ny, nx), any real dtype
        Intensity, or counts that stand for it (`counts`). A volume that is too large for memory
        is a view of a file; read it by `slabs`.
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
    handedness : "right" or "unknown"
        "right" where the file says how its axes lie in space (a mirrored order has then been
        turned round by reversing y); else a mirrored volume can only be told by its shape.
    origins : mapping of str to str
        Where each of the values above was found: "file", "sidecar" or "option".
    notes : tuple of str
        What a reader did that a user should know of.
    space : Space or None
        Where the scan's frame lies in the file's own space (a patient's, a picture's); None where
        the file doesn't say.
    depth_standard : bool
        Whether a step of known height in the sample's medium stands behind the depth. Without
        one shrinkage along depth and an error of the index look the same.
    counts : CountLine or None
        How the volume's numbers become dB; None where they are the intensity. Only
        ``read_scan(..., keep_counts=True)`` leaves counts.
    lateral_error, depth_error : float or None
        Relative standard uncertainty of lengths across and along the light by the device's
        calibration (`registration.devices.optics`), its targets' certificates included; None
        without one.
    walls : WallCalibration or None
        How far off walls come out in scans of this kind, which is to be taken out.
    """

    volume: NDArray[np.generic]
    voxel_mm: tuple[float, float, float]
    refractive_index: float
    optical_depth: bool
    scale: Literal["linear", "db"]
    modality: Literal["oct", "microct", "confocal"]
    depth_down: bool
    came_from: Path
    handedness: Literal["right", "unknown"] = "unknown"
    origins: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    space: Space | None = None
    depth_standard: bool = False
    lateral_error: float | None = None
    depth_error: float | None = None
    counts: CountLine | None = None
    walls: WallCalibration | None = None

    @property
    def intensities(self) -> NDArray[np.float32] | None:
        """Linear intensity of every number that the volume can hold; None unless counts of dB."""
        kind = self.volume.dtype
        if self.scale != "db" or kind.kind not in "ui" or kind.itemsize > 2:
            return None
        return (self.counts or CountLine(1.0, 0.0)).intensities(kind)

    @property
    def geometric_voxel_mm(self) -> tuple[float, float, float]:
        """(dz, dy, dx) with the depth divided by the index where it was optical, mm."""
        dz, dy, dx = self.voxel_mm
        return (dz / self.refractive_index if self.optical_depth else dz, dy, dx)

    def slabs(self, bins: Bins = (1, 1, 1), slab_bytes: int = SLAB_BYTES) -> Iterator[Slab]:
        """The volume part by part, each of whole `bins` and about `slab_bytes`.

        The cuts run along the axis that is slowest in the file, so that a file is read once and
        in order: along y for depth-fastest OCT files, along z for stacks of pages. Voxels that
        fill no whole bin at an end are left out. What was read of a file is given back after each
        part.

        Parameters
        ----------
        bins : (bz, by, bx)
            Voxels that will be averaged into one.
        slab_bytes : int
            About what one slab may hold; at least one bin's thickness is given.
        """
        shape = self.volume.shape
        counts = [size // count for size, count in zip(shape, bins, strict=True)]
        if min(counts) == 0:
            return
        axis = int(np.argmax(np.abs(self.volume.strides)))
        thick = self.volume.itemsize * bins[axis] * self.volume.size // shape[axis]
        step = max(1, slab_bytes // max(1, thick))
        for first in range(0, counts[axis], step):
            last = min(counts[axis], first + step)
            where, part = [slice(0, count) for count in counts], [slice(None)] * 3
            where[axis] = slice(first, last)
            part[axis] = slice(first * bins[axis], last * bins[axis])
            voxels = self.volume[tuple(part)]
            plain = np.ascontiguousarray(voxels, dtype=voxels.dtype.newbyteorder("="))
            yield Slab((where[0], where[1], where[2]), plain)
            drop_pages(self.volume)

"""Write a registered scan as NRRD in the part's frame, for 3D Slicer."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.files import write_bytes
from kernels.arrays import FloatArray
from registration.result import RegistrationReport
from registration.scan import Scan
from registration.segmentation.filters import binned


def write_scan_nrrd(
    path: Path, scan: Scan, report: RegistrationReport, voxel_mm: float | None = None
) -> None:
    """Write a scan with its registration as the volume's own directions and origin.

    3D Slicer then shows it where the design lies: an STL, PLY or VTP of ours, which Slicer takes
    as left-posterior-superior, is in the same space. The directions are those of the scaled fit:
    a shrunken part is shown at the design's size.

    Parameters
    ----------
    path : Path
        Ends in ``.nrrd``.
    scan : Scan
        The volume.
    report : RegistrationReport
        Of that scan.
    voxel_mm : float, optional
        Voxels are averaged to about this edge, which makes a file of a tenth of the size; the
        scan's own voxels by default.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    volume, voxel, first = _binned(scan, voxel_mm)
    matrix = report.scaled_scan_to_part
    directions = matrix[:3, :3] * voxel
    origin = matrix[:3, :3] @ first + matrix[:3, 3]
    header = nrrd_header(volume, directions, origin, "scan in the frame of its part, mm")
    write_bytes(path, header + gzip.compress(volume.tobytes(), 1))


def _binned(
    scan: Scan, voxel_mm: float | None
) -> tuple[NDArray[np.generic], FloatArray, FloatArray]:
    """Volume, its voxels' edges as x, y, z, and the middle of the first one, mm."""
    edges = np.array(scan.geometric_voxel_mm)
    if voxel_mm is None:
        # NRRD has no bool and no half floats; everything else goes as it is.
        volume: NDArray[np.generic] = np.ascontiguousarray(scan.volume)
        if scan.counts is not None:
            volume = scan.counts.decibels(volume)
        if volume.dtype.kind not in "iu" and volume.dtype not in (np.float32, np.float64):
            volume = volume.astype(np.float32)
        return volume, edges[::-1].copy(), np.zeros(3)
    bins = np.maximum(1, np.round(voxel_mm / edges)).astype(int)
    bins = np.minimum(bins, scan.volume.shape)
    bz, by, bx = bins.tolist()
    volume = binned(scan, (bz, by, bx))
    if scan.volume.dtype.kind in "iu" and scan.scale != "db":
        # Back to whole numbers: half the file, and less noise to compress.
        volume = np.round(volume).astype(scan.volume.dtype)
    return volume, (edges * bins)[::-1].copy(), ((bins - 1) / 2 * edges)[::-1].copy()


def nrrd_header(
    volume: NDArray[np.generic], directions: FloatArray, origin: FloatArray, comment: str
) -> bytes:
    """NRRD0005 header (teem.sourceforge.net/nrrd/format.html); axes from fastest to slowest.

    Parameters
    ----------
    volume : (nz, ny, nx) array
        Follows the header, compressed by gzip.
    directions : (3, 3) float64, mm
        Columns: from a voxel to the next in x, y and z.
    origin : (3,) float64, mm
        Middle of the first voxel.
    comment : str
        What it is, one line of ASCII.
    """
    vectors = " ".join(_vector(directions[:, axis]) for axis in range(3))
    lines = [
        "NRRD0005",
        f"# printctl: {comment}",
        f"type: {_type(volume.dtype)}",
        "dimension: 3",
        "space: left-posterior-superior",
        "sizes: " + " ".join(str(n) for n in volume.shape[::-1]),
        f"space directions: {vectors}",
        "kinds: domain domain domain",
        f"endian: {'big' if volume.dtype.str[0] == '>' else 'little'}",
        "encoding: gzip",
        'space units: "mm" "mm" "mm"',
        f"space origin: {_vector(origin)}",
    ]
    return ("\n".join(lines) + "\n\n").encode("ascii")


def _vector(values: FloatArray) -> str:
    return "(" + ",".join(repr(float(v)) for v in values) + ")"


def _type(dtype: np.dtype[np.generic]) -> str:
    if dtype.kind == "f":
        return "float" if dtype.itemsize == 4 else "double"
    return f"{'u' if dtype.kind == 'u' else ''}int{8 * dtype.itemsize}"

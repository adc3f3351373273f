"""Write a predicted print as voxels (NRRD) and as a surface (PLY)."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np

from design.files import write_bytes
from design.solids import Solid, write_ply
from design.tissue.isosurface import isosurface
from registration.files.exports import nrrd_header
from sim.gcode.deposit.lay import Deposit

HALF = 127.5
"""Of 255, the share of ink at which the surface runs."""


def write_voxels(path: Path, laid: Deposit) -> None:
    """Write the share of ink in each voxel, 0 to 255, in the printer's frame.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    volume = np.ascontiguousarray(laid.volume)
    header = nrrd_header(
        volume, np.eye(3) * laid.voxel_mm, laid.origin_mm, "predicted ink, printer's frame, mm"
    )
    write_bytes(path, header + gzip.compress(volume.tobytes(), 1, mtime=0))


def write_surface(path: Path, laid: Deposit) -> None:
    """Write the surface around the ink, in the printer's frame.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    surface = isosurface(laid.volume.transpose(2, 1, 0).astype(np.float32), HALF)
    vertices = (laid.origin_mm + laid.voxel_mm * surface.vertices).astype(np.float32)
    write_ply(path, Solid(vertices.astype(np.float64), surface.faces))

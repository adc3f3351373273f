"""Simulate an OCT scan of a fixed field during a print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from kernels.arrays import FloatArray
from sim.devices.recorded_ink import InkBox
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.output import ScannerOutput
from sim.devices.scanner.placing import Placing
from sim.errors import ScannerError
from sim.gcode.deposit.lay import Laid, deposit_of_laid
from sim.model_file import read_model

_FINEST_MM: Final = 0.02
_PER_VOXEL: Final = 0.625
"""The ink is laid somewhat finer than it is scanned, so that its own voxels don't show."""
_STILL: Final = Placing(0.0, 0.0, 0.0, 0.0, (1.0, 1.0, 1.0))

Micron = Annotated[float, Field(ge=1, le=1000)]
Region = tuple[FloatArray, FloatArray]


class OctField(InkBox):
    """OCT that looks straight down at a box of the printer's frame, and the ink's source.

    Attributes
    ----------
    low_mm, high_mm : (x, y, z), mm
        Corners of the box; the scan begins at its top.
    voxel_um : (x, y, z), µm
        z is optical path.
    refractive_index, attenuation_mm, signal_db, looks
        As of `sim.devices.scanner.oct.OctOptions`.
    laid : InkSource
    """

    voxel_um: tuple[Micron, Micron, Micron] = (20, 20, 15)
    refractive_index: Annotated[float, Field(ge=1, le=2)] = 1.34
    attenuation_mm: Annotated[float, Field(ge=0, le=50)] = 0.7
    signal_db: Annotated[float, Field(ge=0, le=38)] = 33.0
    looks: Annotated[int, Field(ge=1, le=64)] = 3


def live_scan(ink: Laid, field: OctField, seed: int, region: Region | None = None) -> ScannerOutput:
    """Scan what lies in the field; a place of the printer is seen alike in every scan.

    Parameters
    ----------
    ink : Laid
    field : OctField
    seed : int
    region : (low, high), each (3,), mm, optional
        Only what of the field lies in this box of the printer's frame is scanned. What lies above
        it dims nothing, so no ink should.

    Raises
    ------
    DepositError
        When the field is too large.
    ScannerError
        When the region lies outside the field.
    """
    dx, dy, dz = (value * 1e-3 for value in field.voxel_um)
    fine = max(_FINEST_MM, _PER_VOXEL * min(dx, dy, dz))
    low, high = _scanned(field, region)
    # The grid covers a voxel more all round than its box.
    box = np.array([low + fine, high - fine])
    options = OctOptions(
        voxel_mm=(dz, dy, dx),
        refractive_index=field.refractive_index,
        attenuation_mm=field.attenuation_mm,
        signal_db=field.signal_db,
        looks=field.looks,
        start_mm=float(field.high_mm[2] - high[2]),
        placing=_STILL,
    )
    return simulate_oct(deposit_of_laid(ink, fine, box), options, seed)


def _scanned(field: OctField, region: Region | None) -> Region:
    """Return the part of a field's box that is in a region, all of it without one."""
    low, high = np.array(field.low_mm), np.array(field.high_mm)
    if region is None:
        return low, high
    least, most = np.maximum(low, region[0]), np.minimum(high, region[1])
    if not (most - least > 4 * _FINEST_MM).all():
        raise ScannerError(
            f"the region {region[0].tolist()} to {region[1].tolist()} mm lies outside the OCT's "
            f"field, {low.tolist()} to {high.tolist()} mm"
        )
    return least, most


def write_live_scan(path: Path, scan: ScannerOutput) -> None:
    """Write a scan as .npz with what a scanner's file says, and ``printer_to_scan`` (4, 4)."""
    np.savez(
        path,
        volume=scan.volume,
        voxel_mm=np.array(scan.voxel_mm),
        refractive_index=scan.refractive_index,
        optical_depth=scan.optical_depth,
        scale=scan.scale,
        modality=scan.modality,
        depth_down=scan.depth_down,
        printer_to_scan=scan.pose_truth,
    )


def load_oct(path: Path) -> OctField:
    """Read an OCT's YAML file.

    Raises
    ------
    ScannerError
        When it can't be read, or has a key or value that means nothing.
    """
    return read_model(path, OctField, "OCT file", ScannerError)

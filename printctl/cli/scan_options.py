"""Options that say what a scan's file doesn't, and how such a scan is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from printctl.cli.options import three_numbers
from registration import Scan, ScanOverrides, read_scan
from registration.optics import find_surface, read_calibration, undistort
from registration.optics.beam import OctCalibration
from registration.readers import is_mosaic, read_mosaic

_UNCORRECTED = (
    "fan and bow of the OCT's field are not corrected (printctl calibrate oct, --oct-calibration)"
)


def voxel_mm(text: str | None) -> tuple[float, float, float] | None:
    """``X,Y,Z`` in µm to (dz, dy, dx) in mm."""
    if text is None:
        return None
    x, y, z = three_numbers(text, "--voxel-um")
    return (z * 1e-3, y * 1e-3, x * 1e-3)


def corrected_scan(
    path: Path, said: ScanOverrides, calibration: Path | None, air_above: bool
) -> Scan:
    """A scan (or a mosaic of scans), with its beam's faults taken out where that is asked for.

    Raises
    ------
    RegistrationError
        When a file can't be used, or no surface under air is found where there should be one.
    """
    scan = read_mosaic(path, said) if is_mosaic(path) else read_scan(path, said)
    if calibration is None and not air_above:
        return replace(scan, notes=(*scan.notes, _UNCORRECTED)) if scan.modality == "oct" else scan
    device = OctCalibration() if calibration is None else read_calibration(calibration)
    return undistort(scan, device, find_surface(scan) if air_above else None)

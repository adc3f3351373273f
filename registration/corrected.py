"""Read a scan or mosaic; correct OCT distortion if calibrated or scanned through air."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from registration.optics import find_surface, read_calibration, undistort
from registration.optics.beam import OctCalibration
from registration.readers import ScanOverrides, is_mosaic, read_mosaic, read_scan
from registration.scan import Scan

_UNCORRECTED = (
    "Fan and bow of the OCT's field are not corrected (printctl calibrate oct, --oct-calibration)"
)


def corrected_scan(
    path: Path,
    overrides: ScanOverrides,
    calibration: Path | None = None,
    air_above: bool = False,
    keep_counts: bool = False,
) -> Scan:
    """Read a scan, or a mosaic of scans, and take out its beam's faults.

    Parameters
    ----------
    path : Path
        Any known format, or a mosaic's YAML.
    overrides : ScanOverrides
        What the file doesn't say.
    calibration : Path or None
        File of ``printctl calibrate oct``.
    air_above : bool
        Air lies above the sample: refraction at its surface is undone.
    keep_counts : bool
        Leave counts that stand for dB as they are where nothing is corrected (`Scan.counts`).

    Raises
    ------
    RegistrationError
        When a file can't be used, or no surface under air is found where there should be one.
    """
    as_it_is = calibration is None and not air_above
    if is_mosaic(path):
        scan = read_mosaic(path, overrides)
    else:
        scan = read_scan(path, overrides, keep_counts=keep_counts and as_it_is)
    if as_it_is:
        return replace(scan, notes=(*scan.notes, _UNCORRECTED)) if scan.modality == "oct" else scan
    device = OctCalibration() if calibration is None else read_calibration(calibration)
    return undistort(scan, device, find_surface(scan) if air_above else None)

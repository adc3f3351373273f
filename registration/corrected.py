"""Read a scan or mosaic; correct OCT distortion if calibrated or scanned through air."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

from registration.devices.optics import find_surface, read_calibration, undistort
from registration.devices.optics.beam import OctCalibration
from registration.errors import RegistrationError
from registration.files.readers import ScanOverrides, is_mosaic, read_mosaic, read_scan
from registration.scan import Scan
from registration.wall_reference import SAME_VOXEL, WallCalibration, differing

_OLD_NAME = "--walls (in a recipe, walls) is an old name: give its file as --oct-calibration"
_UNCORRECTED = (
    "Fan and bow of the OCT's field are not corrected (printctl calibrate oct, --oct-calibration)"
)


def corrected_scan(
    path: Path,
    overrides: ScanOverrides,
    calibration: Path | None = None,
    air_above: bool = False,
    keep_counts: bool = False,
    walls: Path | None = None,
) -> Scan:
    """Read a scan, or a mosaic of scans; take out its beam's faults, and say how its walls lie.

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
    walls : Path or None
        Another such file, whose walls are taken instead (an old name).

    Raises
    ------
    RegistrationError
        When a file can't be used, was made for another kind of scan, or no surface under air is
        found where there should be one.
    """
    device = OctCalibration() if calibration is None else read_calibration(calibration)
    known = device.walls if walls is None else read_calibration(walls).walls
    if walls is not None and known is None:
        raise RegistrationError(f"{walls}: holds no walls (printctl calibrate oct --reference)")
    device = replace(device, walls=None)
    as_it_is = device == OctCalibration() and not air_above
    if is_mosaic(path):
        scan = read_mosaic(path, overrides)
    else:
        scan = read_scan(path, overrides, keep_counts=keep_counts and as_it_is)
    if not as_it_is:
        scan = undistort(scan, device, find_surface(scan) if air_above else None)
    elif scan.modality == "oct":
        scan = _noted(scan, _UNCORRECTED)
    return _with_walls(_noted(scan, _OLD_NAME) if walls else scan, known)


def _with_walls(scan: Scan, walls: WallCalibration | None) -> Scan:
    """Scan with the offset of its walls, if that was measured on scans of its kind."""
    if walls is None:
        return scan
    here = [1e3 * size for size in scan.geometric_voxel_mm[::-1]]
    other = differing(asdict(walls), {"modality": scan.modality, "voxel_um": here})
    if "modality" in other:
        raise RegistrationError(
            f"{scan.came_from}: a scan by {scan.modality}, and the calibration's walls were "
            f"measured by {walls.modality}; calibrate with a reference scanned as this part was"
        )
    if not other:
        return replace(scan, walls=walls)
    was, now = (" × ".join(f"{size:.3g}" for size in one) for one in (walls.voxel_um or (), here))
    return _noted(
        scan,
        f"Walls were not moved: the reference was scanned in voxels of {was} µm, and this part in "
        f"{now} µm (limit {100 * SAME_VOXEL:.0f} % apart). Scan the reference in these too.",
    )


def _noted(scan: Scan, note: str) -> Scan:
    return replace(scan, notes=(*scan.notes, note))

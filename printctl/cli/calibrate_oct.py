"""`printctl calibrate oct`: fit a device's distortion, scales and walls to scans of targets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from printctl.calibration import Estimate
from printctl.cli.calibrate_options import print_estimates
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, messages
from printctl.cli.scan import voxel_mm
from printctl.errors import UsageError
from printctl.settings import arg, opt
from registration import Scan, ScanOverrides, read_scan
from registration.devices.optics import (
    GridFit,
    OctCalibration,
    Step,
    find_grid,
    fit_grid,
    measure_step,
    read_calibration,
    with_step,
    write_calibration,
)
from registration.wall_reference import WallCalibration, measured_walls, read_reference

_MEANING = {
    "scale_x": ("scale along x", ""), "shear": ("shear of y along x", ""),
    "scale_y": ("scale along y", ""), "bow_xx": ("bow along x", "1/mm"),
    "bow_xy": ("bow, mixed", "1/mm"), "bow_yy": ("bow along y", "1/mm"),
    "fan_x": ("fan along x", "1/mm"), "fan_y": ("fan along y", "1/mm"),
    "depth_scale": ("scale of depth in air", ""),
    "refractive_index": ("group index of the medium", ""),
}  # fmt: skip


@command
def oct_device(
    grid: list[Path] | None = opt("Scan of a flat dot grid in air; again at another height."),
    pitch_um: float | None = opt("Of the grid's dots.", min=10),
    pitch_u_um: float = opt("U (k = 2) of the pitch by the grid's certificate.", 0.0, min=0.0),
    step: Path | None = opt("Scan of a step of known height."),
    height_um: float | None = opt("Of the step.", min=10),
    height_u_um: float = opt("U (k = 2) of the height by the step's certificate.", 0.0, min=0.0),
    reference: list[Path] | None = opt(
        "Report folder of a part whose model is what it truly is; again of other scans."
    ),
    reference_u_um: float = opt("U (k = 2) of its diameters by its certificate.", 0.0, min=0.0),
    immersed: bool = opt("The step lay in the medium of the prints.", False, "--immersed/--in-air"),
    voxel_um: str | None = opt("Where the files don't say; Z as optical path.", metavar="X,Y,Z"),
    axes: str | None = opt("Order of axes, slowest first.", metavar="ZYX"),
    scale: Literal["linear", "db"] | None = opt("Of the intensity, where the files don't say."),
    write: Path | None = opt(
        "YAML file for `register --oct-calibration`; what it says of other targets stays."
    ),
    as_json: JsonFlag = False,
) -> None:
    """Fan, bow, scales and walls of a device: from a dot grid, a step, a part of known channels.

    Scan the grid in air at two heights at least 0.5 mm apart: one height can't show the fan.
    The step in air gives the scale of depth; under the medium (--immersed) its group index.
    The part's diameters give the offset of walls: register it with the model that it truly is.
    """
    overrides = ScanOverrides(
        voxel_mm=voxel_mm(voxel_um), refractive_index=1.0, scale=scale, modality="oct", axes=axes
    )
    if overrides.voxel_mm is not None:
        overrides = ScanOverrides(**{**overrides.__dict__, "optical_depth": True})
    if not grid and step is None and not reference:
        raise UsageError(
            "give scans of a grid (--grid), of a step (--step) or reports of a part of known "
            "diameters (--reference)"
        )
    kept = write is not None and write.exists()
    calibration = read_calibration(write) if write and kept else OctCalibration()
    notes = [f"with what {write} said of other targets"] if kept else []
    if step is not None:
        heights = height_um, height_u_um
        measured, calibration = _step(_read(step, overrides), heights, calibration, immersed)
        notes.append(_told_step(measured, immersed, height_u_um))
    if grid:
        fit = _grid([_read(path, overrides) for path in grid], (pitch_um, pitch_u_um), calibration)
        calibration = fit.calibration
        notes.append(_told_grid(fit))
    if reference:
        walls = measured_walls([read_reference(path) for path in reference], reference_u_um)
        calibration = replace(calibration, walls=walls)
        notes += _told_reference(walls, reference_u_um)
    if (grid or step) and not calibration.depth_standard:
        notes.append(
            "no step in the medium: depth has no standard, so an error of the index and shrinkage "
            "along depth look the same"
        )
    print_estimates(_estimates(calibration), notes, as_json)
    if write is not None:
        write_calibration(write, calibration)
        messages().print(f"wrote {write}", markup=False)


def _read(path: Path, overrides: ScanOverrides) -> Scan:
    """A target's scan, in air: the path is the depth."""
    return read_scan(path, overrides)


def _step(
    scan: Scan, heights: tuple[float | None, float], base: OctCalibration, immersed: bool
) -> tuple[Step, OctCalibration]:
    height_um, u_um = heights
    if height_um is None:
        raise UsageError("--step needs the step's height: give --height-um")
    measured = measure_step(scan)
    return measured, with_step(
        base, measured, height_um * 1e-3, immersed=immersed, height_u_mm=u_um * 1e-3
    )


def _grid(scans: list[Scan], pitches: tuple[float | None, float], base: OctCalibration) -> GridFit:
    pitch_um, u_um = pitches
    if pitch_um is None:
        raise UsageError("--grid needs the distance of its dots: give --pitch-um")
    views = [find_grid(scan, pitch_um * 1e-3) for scan in scans]
    return fit_grid(views, pitch_um * 1e-3, base, u_um * 1e-3)


def _estimates(calibration: OctCalibration) -> dict[str, Estimate]:
    (scale_x, shear), (_, scale_y) = calibration.lateral
    bow, fan = calibration.bow_per_mm, calibration.fan_per_mm
    values = {
        "scale_x": scale_x, "shear": shear, "scale_y": scale_y,
        "bow_xx": bow[0], "bow_xy": bow[1], "bow_yy": bow[2], "fan_x": fan[0], "fan_y": fan[1],
        "depth_scale": calibration.depth_scale, "refractive_index": calibration.refractive_index,
    }  # fmt: skip
    lines = {}
    for name, (low, high) in calibration.intervals.items():
        value = values[name]
        if value is not None:
            meaning, unit = _MEANING[name]
            lines[meaning] = Estimate(value, low, high, unit)
    if calibration.walls is not None:
        value, half = calibration.walls.offset_um, calibration.walls.interval_um
        lines["walls lie further into the gel by"] = Estimate(
            value, value - half, value + half, "µm"
        )
    return lines


def _told_step(step: Step, immersed: bool, u_um: float) -> str:
    where = "in the medium" if immersed else "in air"
    return (
        f"step {where}: {1e3 * step.path_mm:.1f} µm of path, columns scatter by "
        f"{1e3 * step.scatter_mm:.1f} µm, tilted by {step.tilt_deg:.1f}°; its height is "
        + (f"known to ± {u_um:g} µm by its certificate" if u_um else "taken as exact")
    )


def _told_grid(fit: GridFit) -> str:
    fan = "" if fit.fan_known else "; one height, so the fan is unknown and taken as 0"
    return (
        f"grid: {fit.dots} dots, {fit.before_um:.1f} µm off as the device says, "
        f"{fit.lateral_um:.1f} µm in the plane and {fit.depth_um:.1f} µm in depth after it{fan}"
    )


def _told_reference(walls: WallCalibration, u_um: float) -> list[str]:
    notes = [
        f"reference: {walls.scans} scan(s), lumens of {walls.from_um:.0f} to {walls.to_um:.0f} µm, "
        + (f"known to ± {u_um:g} µm by their certificate" if u_um else "taken as exact")
        + "; holds for this device, voxel size and material alone"
    ]
    if walls.scans == 1:
        notes.append("one scan: its interval doesn't hold what differs from scan to scan")
    return notes


@command
def walls(
    phantoms: list[Path] = arg("Report folders of a reference, as --reference takes them."),
    write: Path | None = opt("YAML file for `register --oct-calibration`."),
    as_json: JsonFlag = False,
) -> None:
    """Old name of `calibrate oct --reference`, for one more release.

    The file that it writes is the device's, for `register --oct-calibration`.
    """
    messages().print("note: the new name is printctl calibrate oct --reference", markup=False)
    oct_device(reference=phantoms, write=write, as_json=as_json)

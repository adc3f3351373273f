"""Calibrate an OCT device: scales, bow and fan by a dot grid, depth by a step, walls by a part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from printctl.calibration.estimate import Estimate
from registration import Scan
from registration.devices.optics import (
    OctCalibration,
    find_grid,
    fit_grid,
    measure_step,
    read_calibration,
    with_step,
)
from registration.wall_reference import ReferenceScan, measured_walls

_MEANING: Final = {
    "scale_x": ("scale along x", ""), "shear": ("shear of y along x", ""),
    "scale_y": ("scale along y", ""), "bow_xx": ("bow along x", "1/mm"),
    "bow_xy": ("bow, mixed", "1/mm"), "bow_yy": ("bow along y", "1/mm"),
    "fan_x": ("fan along x", "1/mm"), "fan_y": ("fan along y", "1/mm"),
    "depth_scale": ("scale of depth in air", ""),
    "refractive_index": ("group index of the medium", ""),
}  # fmt: skip


@dataclass
class ScannerCalibration:
    """A device's calibration, and what was said of the targets that it was made of.

    Attributes
    ----------
    calibration : OctCalibration
    notes : list of str
    """

    calibration: OctCalibration = field(default_factory=OctCalibration)
    notes: list[str] = field(default_factory=list)
    _scanned: bool = False

    @classmethod
    def beside(cls, path: Path | None) -> ScannerCalibration:
        """Begin with what a file says of other targets, if there is one."""
        if path is None or not path.exists():
            return cls()
        return cls(read_calibration(path), [f"with what {path} said of other targets"])

    def add_step(self, scan: Scan, height_um: float, u_um: float, *, immersed: bool) -> None:
        """Take a step of known height, with U (k = 2): depth in air, or the medium's index."""
        step = measure_step(scan)
        self.calibration = with_step(
            self.calibration, step, height_um * 1e-3, immersed=immersed, height_u_mm=u_um * 1e-3
        )
        self._scanned = True
        where = "in the medium" if immersed else "in air"
        self.notes.append(
            f"step {where}: {1e3 * step.path_mm:.1f} µm of path, columns scatter by "
            f"{1e3 * step.scatter_mm:.1f} µm, tilted by {step.tilt_deg:.1f}°; its height is "
            + (f"known to ± {u_um:g} µm by its certificate" if u_um else "taken as exact")
        )

    def add_grid(self, scans: Sequence[Scan], pitch_um: float, u_um: float) -> None:
        """Take a dot grid of known pitch, with U (k = 2), in air; two heights show the fan."""
        views = [find_grid(scan, pitch_um * 1e-3) for scan in scans]
        fit = fit_grid(views, pitch_um * 1e-3, self.calibration, u_um * 1e-3)
        self.calibration, self._scanned = fit.calibration, True
        fan = "" if fit.fan_known else "; one height, so the fan is unknown and taken as 0"
        self.notes.append(
            f"grid: {fit.dots} dots, {fit.before_um:.1f} µm off as the device says, "
            f"{fit.lateral_um:.1f} µm in the plane and {fit.depth_um:.1f} µm in depth after it{fan}"
        )

    def add_reference(self, reports: Sequence[ReferenceScan], u_um: float) -> None:
        """Take registrations of a part of known diameters, with U (k = 2): the offset of walls."""
        walls = measured_walls(list(reports), u_um)
        self.calibration = replace(self.calibration, walls=walls)
        self.notes.append(
            f"reference: {walls.scans} scan(s), lumens of {walls.from_um:.0f} to "
            f"{walls.to_um:.0f} µm, "
            + (f"known to ± {u_um:g} µm by their certificate" if u_um else "taken as exact")
            + "; holds for this device, voxel size and material alone"
        )
        if walls.scans == 1:
            self.notes.append("one scan: its interval doesn't hold what differs from scan to scan")

    def all_notes(self) -> list[str]:
        """The notes, and what the targets together leave open."""
        if not self._scanned or self.calibration.depth_standard:
            return self.notes
        return [
            *self.notes,
            "no step in the medium: depth has no standard, so an error of the index and shrinkage "
            "along depth look the same",
        ]

    def estimates(self) -> dict[str, Estimate]:
        """What is known of the device, by its meaning."""
        made = self.calibration
        (scale_x, shear), (_, scale_y) = made.lateral
        bow, fan = made.bow_per_mm, made.fan_per_mm
        values = {
            "scale_x": scale_x, "shear": shear, "scale_y": scale_y,
            "bow_xx": bow[0], "bow_xy": bow[1], "bow_yy": bow[2], "fan_x": fan[0], "fan_y": fan[1],
            "depth_scale": made.depth_scale, "refractive_index": made.refractive_index,
        }  # fmt: skip
        lines = {}
        for name, (low, high) in made.intervals.items():
            value = values[name]
            if value is not None:
                meaning, unit = _MEANING[name]
                lines[meaning] = Estimate(value, low, high, unit)
        if made.walls is not None:
            value, half = made.walls.offset_um, made.walls.interval_um
            lines["walls lie further into the gel by"] = Estimate(
                value, value - half, value + half, "µm"
            )
        return lines

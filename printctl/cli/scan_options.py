"""Command-line options of a scan: metadata that its file lacks, calibrations, filled lumens.

Commands take them all as `ScanOptions` (`printctl.cli.option_group`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from printctl.cli.options import three_numbers, two_numbers
from registration.files import readers

if TYPE_CHECKING:
    from registration.files.readers import ScanOverrides

ScanFile = Annotated[
    Path,
    typer.Argument(
        help="A scan of any known format, or a mosaic's YAML (docs/scans.md).", show_default=False
    ),
]
VoxelUm = Annotated[
    str | None,
    typer.Option("--voxel-um", metavar="X,Y,Z", help="Where the scan's file doesn't say."),
]
RefractiveIndex = Annotated[
    float | None, typer.Option("--refractive-index", help="Group index of gel and liquid.")
]
OpticalDepth = Annotated[
    bool | None,
    typer.Option("--optical-depth/--geometric-depth", help="What the depth voxel counts."),
]
Modality = Annotated[
    Literal["oct", "microct", "confocal"] | None, typer.Option("--modality", help="What measured.")
]
Scale = Annotated[Literal["linear", "db"] | None, typer.Option("--scale", help="Of the intensity.")]
Axes = Annotated[
    str | None,
    typer.Option("--axes", metavar="ZYX", help="Order of the file's axes, slowest first."),
]
DepthDown = Annotated[
    bool | None,
    typer.Option("--depth-down/--depth-up", help="Which way growing depth index goes."),
]
Mirrored = Annotated[
    bool | None,
    typer.Option("--mirrored/--not-mirrored", help="The file's x, y, z are left-handed."),
]
DbRange = Annotated[
    str | None,
    typer.Option("--db-range", metavar="LOW,HIGH", help="dB of the lowest and highest count."),
]
CountRange = Annotated[
    str | None,
    typer.Option(
        "--count-range", metavar="LOW,HIGH", help="Counts that mean --db-range; else the type's."
    ),
]
CountsPerDb = Annotated[
    float | None, typer.Option("--counts-per-db", help="In place of --db-range.")
]
DbAtZero = Annotated[
    float | None, typer.Option("--db-at-zero", help="dB of count 0, with --counts-per-db.")
]
OctCalibrationFile = Annotated[
    Path | None, typer.Option("--oct-calibration", help="File of `printctl calibrate oct`.")
]
AirAbove = Annotated[
    bool,
    typer.Option("--air-above", help="Air lies above the sample: undo refraction at its surface."),
]
WallsFile = Annotated[
    Path | None,
    typer.Option("--walls", help="Old name for a file of walls; give it as --oct-calibration."),
]
Filled = Annotated[
    bool,
    typer.Option("--filled", help="Lumens are brighter than the gel: filled with contrast agent."),
]


@dataclass(frozen=True)
class ScanOptions:
    """What the command line says of a scan and of its calibrations, as typer reads it."""

    voxel_um: VoxelUm = None
    refractive_index: RefractiveIndex = None
    optical_depth: OpticalDepth = None
    modality: Modality = None
    scale: Scale = None
    axes: Axes = None
    depth_down: DepthDown = None
    mirrored: Mirrored = None
    db_range: DbRange = None
    count_range: CountRange = None
    counts_per_db: CountsPerDb = None
    db_at_zero: DbAtZero = None
    oct_calibration: OctCalibrationFile = None
    air_above: AirAbove = False
    walls: WallsFile = None
    filled: Filled = False

    def overrides(self) -> ScanOverrides:
        """What the scan's file doesn't say; raises `UsageError` for numbers that aren't."""
        db, counts = self.db_range, self.count_range
        return readers.ScanOverrides(
            voxel_mm=voxel_mm(self.voxel_um),
            refractive_index=self.refractive_index,
            optical_depth=self.optical_depth,
            scale=self.scale,
            modality=self.modality,
            depth_down=self.depth_down,
            axes=self.axes,
            mirrored=self.mirrored,
            db_range=None if db is None else two_numbers(db, "--db-range"),
            count_range=None if counts is None else two_numbers(counts, "--count-range"),
            counts_per_db=self.counts_per_db,
            db_at_zero=self.db_at_zero,
        )


def voxel_mm(text: str | None) -> tuple[float, float, float] | None:
    """``X,Y,Z`` in µm to (dz, dy, dx) in mm."""
    if text is None:
        return None
    x, y, z = three_numbers(text, "--voxel-um")
    return (z * 1e-3, y * 1e-3, x * 1e-3)
